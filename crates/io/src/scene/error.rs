//! Errors of input files: what, where (file, line, column, the text itself), why and what to write.

use std::fmt;
use std::ops::Range;
use std::path::Path;
use std::sync::Arc;

use miette::{Diagnostic, LabeledSpan, NamedSource, Severity, SourceCode, SourceSpan};
use serde::ser::SerializeStruct;

/// A text that values come from: a file, or one `--set` argument.
#[derive(Debug)]
pub struct Source {
    named: NamedSource<Arc<str>>,
}

impl Source {
    pub(crate) fn new(name: &str, text: &str) -> Arc<Self> {
        Arc::new(Self { named: NamedSource::new(name, Arc::from(text)) })
    }

    /// The file's name as given, or `--set`.
    pub fn name(&self) -> &str {
        self.named.name()
    }

    /// The whole text.
    pub fn text(&self) -> &str {
        self.named.inner()
    }
}

/// A stretch of a source.
#[derive(Clone)]
pub struct Place {
    source: Arc<Source>,
    span: Range<usize>,
}

impl Place {
    pub(crate) fn new(source: &Arc<Source>, span: Range<usize>) -> Self {
        let end = source.text().len();
        Self { source: Arc::clone(source), span: span.start.min(end)..span.end.min(end) }
    }

    /// Another stretch of the same source.
    pub(crate) fn part(&self, span: Range<usize>) -> Self {
        Self::new(&self.source, span)
    }

    /// Where the text comes from.
    pub fn source(&self) -> &Source {
        &self.source
    }

    /// Byte range in the source.
    pub fn span(&self) -> Range<usize> {
        self.span.clone()
    }

    /// The text itself.
    pub fn text(&self) -> &str {
        self.source.text().get(self.span.clone()).unwrap_or_default()
    }

    /// Line and column in characters, from 1.
    pub fn line_column(&self) -> (usize, usize) {
        let before = self.source.text().get(..self.span.start).unwrap_or_default();
        let line_start = before.rfind('\n').map_or(0, |at| at + 1);
        (before.matches('\n').count() + 1, before[line_start..].chars().count() + 1)
    }
}

impl fmt::Debug for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (line, column) = self.line_column();
        write!(f, "{}:{line}:{column}", self.source.name())
    }
}

/// A value and where it was written. Two are equal when their values are.
#[derive(Clone, Debug)]
pub struct Located<T> {
    /// The value.
    pub value: T,
    /// Where it was written.
    pub place: Place,
}

impl<T: PartialEq> PartialEq for Located<T> {
    fn eq(&self, other: &Self) -> bool {
        self.value == other.value
    }
}

/// One thing that is wrong with an input file, or, with [`Severity::Warning`], looks wrong.
///
/// `{}` prints the message alone, `{:#}` the full plain text with file, line and underline; a `miette`
/// handler prints the same with colours.
#[derive(Clone, Debug)]
pub struct SceneError {
    code: &'static str,
    message: String,
    label: String,
    help: Option<String>,
    severity: Severity,
    place: Place,
}

impl SceneError {
    pub(crate) fn new(code: &'static str, place: &Place, message: impl Into<String>) -> Self {
        Self {
            code,
            message: message.into(),
            label: String::new(),
            help: None,
            severity: Severity::Error,
            place: place.clone(),
        }
    }

    /// Sets the words beside the underline.
    pub(crate) fn label(mut self, label: impl Into<String>) -> Self {
        self.label = label.into();
        self
    }

    /// Sets what to do about it.
    pub(crate) fn help(mut self, help: impl Into<String>) -> Self {
        self.help = Some(help.into());
        self
    }

    pub(crate) fn warning(mut self) -> Self {
        self.severity = Severity::Warning;
        self
    }

    pub(crate) fn unreadable(path: &Path, error: &std::io::Error, help: &str) -> Self {
        let source = Source::new(&path.display().to_string(), "");
        Self::new(
            "unreadable",
            &Place::new(&source, 0..0),
            format!("cannot read `{}`: {error}", path.display()),
        )
        .help(help)
    }

    /// What kind of mistake it is, for programs: a fixed word such as `unknown-key`.
    pub fn kind(&self) -> &'static str {
        self.code
    }

    /// What is wrong, in one sentence.
    pub fn message(&self) -> &str {
        &self.message
    }

    /// What to do about it.
    pub fn advice(&self) -> Option<&str> {
        self.help.as_deref()
    }

    /// Where it is.
    pub fn place(&self) -> &Place {
        &self.place
    }

    /// Whether it is a warning, which does not stop a run.
    pub fn is_warning(&self) -> bool {
        self.severity == Severity::Warning
    }
}

impl fmt::Display for SceneError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if !f.alternate() {
            return f.write_str(&self.message);
        }
        let (line, column) = self.place.line_column();
        let word = if self.is_warning() { "warning" } else { "error" };
        writeln!(f, "{}:{line}:{column}: {word}: {}", self.place.source.name(), self.message)?;
        if let Some(text) = self.place.source.text().lines().nth(line - 1) {
            let width = self.place.text().lines().next().map_or(1, |t| t.chars().count()).max(1);
            let indent = " ".repeat(line.to_string().len());
            // Tabs are kept, so that the marks stand below the text whatever their width.
            let lead: String =
                text.chars().take(column - 1).map(|c| if c == '\t' { c } else { ' ' }).collect();
            writeln!(f, "{line} | {text}")?;
            writeln!(f, "{}", format!("{indent} | {lead}{} {}", "^".repeat(width), self.label).trim_end())?;
        }
        if let Some(help) = &self.help {
            writeln!(f, "  help: {help}")?;
        }
        Ok(())
    }
}

impl std::error::Error for SceneError {}

impl Diagnostic for SceneError {
    fn code<'a>(&'a self) -> Option<Box<dyn fmt::Display + 'a>> {
        Some(Box::new(self.code))
    }
    fn severity(&self) -> Option<Severity> {
        Some(self.severity)
    }
    fn help<'a>(&'a self) -> Option<Box<dyn fmt::Display + 'a>> {
        self.help.as_ref().map(|help| Box::new(help) as Box<dyn fmt::Display>)
    }
    fn source_code(&self) -> Option<&dyn SourceCode> {
        Some(&self.place.source.named)
    }
    fn labels(&self) -> Option<Box<dyn Iterator<Item = LabeledSpan> + '_>> {
        let span = SourceSpan::from(self.place.span());
        let label = (!self.label.is_empty()).then(|| self.label.clone());
        Some(Box::new(std::iter::once(LabeledSpan::new_with_span(label, span))))
    }
}

/// For `--json`: severity, code, file, line, column, message and help.
impl serde::Serialize for SceneError {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let (line, column) = self.place.line_column();
        let mut out = serializer.serialize_struct("SceneError", 8)?;
        out.serialize_field("severity", if self.is_warning() { "warning" } else { "error" })?;
        out.serialize_field("code", self.code)?;
        out.serialize_field("file", self.place.source.name())?;
        out.serialize_field("line", &line)?;
        out.serialize_field("column", &column)?;
        out.serialize_field("text", self.place.text())?;
        out.serialize_field("message", &self.message)?;
        out.serialize_field("help", &self.help)?;
        out.end()
    }
}
