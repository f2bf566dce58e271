//! What verbs say: results on standard output, everything else on standard error.

use std::io::{ErrorKind, IsTerminal as _, Write as _};
use std::process::ExitCode;
use std::sync::{Arc, Mutex, PoisonError};

use glebe_engine::backend::Unavailable;
use glebe_io::scene::SceneError;
use glebe_study::sweep::StudyError;
use miette::{GraphicalReportHandler, GraphicalTheme};
use serde_json::{Value, json};

use crate::run::RunError;

/// How a verb ended that did its work.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ended {
    /// All of it: exit code 0.
    Done,
    /// All of it, and the outcome is not the expected one: exit code 1.
    Unmet,
    /// Up to where the user stopped it: exit code 130.
    Interrupted,
}

/// Why a verb did not do its work.
#[derive(Debug)]
pub enum Problem {
    /// Mistakes in a scene: exit code 2.
    Scene(Vec<SceneError>),
    /// Something else that was given is wrong: exit code 2.
    Input(String),
    /// It was begun and failed: exit code 1.
    Failed(String),
}

impl From<RunError> for Problem {
    fn from(error: RunError) -> Self {
        if error.is_input() { Self::Input(error.to_string()) } else { Self::Failed(error.to_string()) }
    }
}

impl From<StudyError> for Problem {
    fn from(error: StudyError) -> Self {
        if error.is_input() { Self::Input(error.to_string()) } else { Self::Failed(error.to_string()) }
    }
}

impl From<Unavailable> for Problem {
    fn from(error: Unavailable) -> Self {
        Self::Input(error.to_string())
    }
}

impl Problem {
    fn exit_code(&self) -> u8 {
        match self {
            Self::Scene(_) | Self::Input(_) => 2,
            Self::Failed(_) => 1,
        }
    }

    fn errors(&self) -> Value {
        match self {
            Self::Scene(errors) => json!(errors),
            Self::Input(message) => json!([{ "severity": "error", "code": "input", "message": message }]),
            Self::Failed(message) => json!([{ "severity": "error", "code": "failed", "message": message }]),
        }
    }
}

/// Where messages go.
#[derive(Debug)]
pub struct Ui {
    json: bool,
    quiet: bool,
    /// What went wrong with standard output.
    lost: Arc<Mutex<Option<std::io::Error>>>,
}

impl Ui {
    /// For people, or with `json` for programs.
    pub fn new(json: bool) -> Self {
        Self { json, quiet: false, lost: Arc::default() }
    }

    /// The same, without notes if `quiet`.
    #[must_use]
    pub fn quieted(&self, quiet: bool) -> Self {
        Self { quiet: self.quiet || quiet, lost: Arc::clone(&self.lost), ..*self }
    }

    /// Whether only warnings and errors are told.
    pub fn quiet(&self) -> bool {
        self.quiet
    }

    /// Whether standard output is for a program.
    pub fn json(&self) -> bool {
        self.json
    }

    /// Writes a text to standard output. Nobody needs to be told of a closed pipe; of a full disk the exit code
    /// tells.
    pub fn print(&self, text: &str) {
        let mut out = std::io::stdout().lock();
        let written = writeln!(out, "{}", text.trim_end()).and_then(|()| out.flush());
        if let Err(error) = written
            && error.kind() != ErrorKind::BrokenPipe
        {
            self.lost.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(error);
        }
    }

    /// The result: `value` for programs, `text` for people.
    pub fn result(&self, value: &Value, text: &str) {
        if self.json {
            self.print(&format!("{value:#}"));
        } else if !text.is_empty() {
            self.print(text);
        }
    }

    /// A line for the log; not with `--json`, nor if quiet.
    pub fn note(&self, line: &str) {
        if !self.quiet {
            self.tell(line);
        }
    }

    fn tell(&self, line: &str) {
        if !self.json {
            let _ = writeln!(std::io::stderr(), "{line}");
        }
    }

    /// Something that looks wrong and does not stop the work; not with `--json`, where it belongs to the
    /// result.
    pub fn warn(&self, line: &str) {
        self.tell(&format!("warning: {line}"));
    }

    /// Scene errors or warnings, with the lines that they are about.
    pub fn scene(&self, errors: &[SceneError]) {
        for error in errors {
            self.tell(render(error).trim_end());
        }
    }

    /// Tells how it ended, and gives the exit code.
    pub(super) fn end(&self, ended: Result<Ended, Problem>) -> ExitCode {
        let lost = self.lost.lock().unwrap_or_else(PoisonError::into_inner).take();
        let ended = match (ended, lost) {
            (Ok(_), Some(error)) => {
                Err(Problem::Failed(format!("standard output cannot be written: {error}")))
            }
            (ended, _) => ended,
        };
        let problem = match ended {
            Ok(Ended::Done) => return ExitCode::SUCCESS,
            Ok(Ended::Unmet) => return ExitCode::from(1),
            Ok(Ended::Interrupted) => return ExitCode::from(130),
            Err(problem) => problem,
        };
        let code = problem.exit_code();
        if self.json {
            self.print(&format!(
                "{:#}",
                json!({ "status": "error", "exit_code": code, "errors": problem.errors() })
            ));
        }
        match &problem {
            Problem::Scene(errors) => {
                self.scene(errors);
                let count = errors.iter().filter(|e| !e.is_warning()).count();
                self.tell(&format!("{count} error{}; nothing was run", if count == 1 { "" } else { "s" }));
            }
            Problem::Input(message) | Problem::Failed(message) => self.tell(&format!("error: {message}")),
        }
        ExitCode::from(code)
    }
}

/// A word of a command line for a POSIX shell, in quotes if it needs them.
pub(super) fn shell_word(text: &str) -> String {
    let plain = |c: char| c.is_ascii_alphanumeric() || "-_./=+:,@%".contains(c);
    if !text.is_empty() && text.chars().all(plain) {
        return text.to_owned();
    }
    format!("'{}'", text.replace('\'', r"'\''"))
}

/// With colours and lines for a terminal, else as plain text.
fn render(error: &SceneError) -> String {
    let stderr = std::io::stderr();
    let plain = format!("{error:#}");
    if !stderr.is_terminal() {
        return plain;
    }
    let colours = std::env::var_os("NO_COLOR").is_none_or(|v| v.is_empty());
    let theme = if colours { GraphicalTheme::unicode() } else { GraphicalTheme::unicode_nocolor() };
    let mut text = String::new();
    match GraphicalReportHandler::new_themed(theme).render_report(&mut text, error) {
        Ok(()) => text,
        Err(_) => plain,
    }
}
