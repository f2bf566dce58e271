//! The command `glebe`: verbs, messages, exit codes.
//!
//! A verb is a module with `Args` (which hold its help) and `fn run(Args, &Ui) -> Result<Ended, Problem>`.

mod bar;
mod calibrate;
mod check;
mod devices;
mod new;
mod run;
mod rve;
mod study;
mod sweep;
mod ui;

use std::process::ExitCode;

use clap::{CommandFactory, Parser, Subcommand};

use crate::bench::BenchError;
pub use ui::{Ended, Problem, Ui};

/// Simulates granular matter with the Discrete Element Method: soil under tools, drums, silos.
#[derive(Debug, Parser)]
#[command(name = "glebe", version, propagate_version = true, after_help = EXAMPLES)]
struct Cli {
    /// Prints errors and results as JSON on standard output
    #[arg(long, global = true)]
    json: bool,
    #[command(subcommand)]
    verb: Verb,
}

const EXAMPLES: &str = "\
Examples:
  glebe new field --quick              a small tillage scene in the folder `field`
  glebe run field/scene.toml           runs it; results go to `field/out`
  glebe run field/scene.toml --resume  goes on after an interruption
  glebe sweep field/study.toml         many variants of a scene
  glebe rve sand/study.toml            periodic samples under stress and strain
  glebe calibrate fit/study.toml       parameters that give what was measured

Exit codes: 0 done, 1 the run failed, 2 the input is wrong, 130 interrupted (--resume continues).";

#[derive(Debug, Subcommand)]
enum Verb {
    New(new::Args),
    Check(check::Args),
    Run(run::Args),
    Sweep(sweep::Args),
    Rve(rve::Args),
    Calibrate(calibrate::Args),
    Validate(crate::validate::ValidateArgs),
    Bench(crate::bench::BenchArgs),
    Devices(devices::Args),
    /// Prints the JSON Schema of scene, study or calibration files, for editors
    #[command(after_help = "\
Examples:
  glebe schema > scene.schema.json     then put `#:schema scene.schema.json` at the top of scene.toml
  glebe schema study
  glebe schema calibration")]
    Schema {
        /// Which files
        #[arg(default_value = "scene", value_parser = ["scene", "study", "calibration"])]
        of: String,
    },
    /// Prints completions for a shell
    #[command(after_help = "\
Examples:
  glebe completions bash > ~/.local/share/bash-completion/completions/glebe
  glebe completions zsh > ~/.zfunc/_glebe")]
    Completions {
        /// The shell
        shell: clap_complete::Shell,
    },
}

/// Runs the program.
pub fn main() -> ExitCode {
    keep_order_of_devices();
    #[cfg(unix)]
    outlive_file_size_limits();
    let cli = match Cli::try_parse() {
        Ok(cli) => cli,
        Err(error) => return usage(&error),
    };
    let ui = Ui::new(cli.json);
    let ended = match cli.verb {
        Verb::New(args) => new::run(&args, &ui),
        Verb::Check(args) => check::run(&args, &ui),
        Verb::Run(args) => run::run(&args, &ui),
        Verb::Sweep(args) => sweep::run(&args, &ui),
        Verb::Rve(args) => rve::run(&args, &ui),
        Verb::Calibrate(args) => calibrate::run(&args, &ui),
        Verb::Validate(args) => validate(&args, &ui),
        Verb::Bench(args) => match crate::bench::run(&args, &ui) {
            Ok(()) => Ok(Ended::Done),
            Err(BenchError::Device(why)) => Err(why.into()),
            Err(why @ BenchError::Compare { .. }) => Err(Problem::Input(why.to_string())),
            Err(e) => Err(Problem::Failed(e.to_string())),
        },
        Verb::Devices(_) => {
            devices::run(&ui);
            Ok(Ended::Done)
        }
        Verb::Schema { of } => {
            let schema = match of.as_str() {
                "study" => glebe_io::study::schema(),
                "calibration" => glebe_io::study::calibration_schema(),
                _ => glebe_io::scene::schema(),
            };
            ui.print(&format!("{schema:#}"));
            Ok(Ended::Done)
        }
        Verb::Completions { shell } => {
            let mut text = Vec::new();
            clap_complete::generate(shell, &mut Cli::command(), "glebe", &mut text);
            ui.print(&String::from_utf8_lossy(&text));
            Ok(Ended::Done)
        }
    };
    ui.end(ended)
}

/// Keeps a layer of Mesa's from asking a display which device is its own: it would put that one first, and
/// complain on standard error where there is no display.
fn keep_order_of_devices() {
    const LAYER: &str = "NODEVICE_SELECT";
    if cfg!(target_os = "linux") && std::env::var_os(LAYER).is_none() {
        // SAFETY: the program begins here, and no other thread is there to read the environment.
        #[allow(unsafe_code)]
        unsafe {
            std::env::set_var(LAYER, "1");
        }
    }
}

/// A file that may not grow further is an error with a message, not the end of the program.
#[cfg(unix)]
fn outlive_file_size_limits() {
    let noticed = std::sync::Arc::default();
    // Without it a run still ends, only with less said.
    let _ = signal_hook::flag::register(signal_hook::consts::SIGXFSZ, noticed);
}

fn validate(args: &crate::validate::ValidateArgs, ui: &Ui) -> Result<Ended, Problem> {
    match crate::validate::run(args, ui) {
        Ok(true) => Ok(Ended::Done),
        Ok(false) => Ok(Ended::Unmet),
        Err(e) if e.exit_code() == 2 => Err(Problem::Input(e.to_string())),
        Err(e) => Err(Problem::Failed(e.to_string())),
    }
}

/// Help, the version, or a command line that makes no sense (exit code 2).
fn usage(error: &clap::Error) -> ExitCode {
    if error.use_stderr() && std::env::args().any(|a| a == "--json") {
        let text = error.to_string();
        let text = text.trim().trim_start_matches("error: ");
        return Ui::new(true).end(Err(Problem::Input(text.to_owned())));
    }
    // A closed pipe is nobody to tell.
    let _ = error.print();
    ExitCode::from(u8::try_from(error.exit_code()).unwrap_or(2))
}
