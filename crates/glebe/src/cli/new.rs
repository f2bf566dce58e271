//! `glebe new`: a folder to start from.

use std::fs;
use std::path::PathBuf;

use clap::builder::{PossibleValue, PossibleValuesParser};
use serde_json::json;

use super::ui::shell_word;
use super::{Ended, Problem, Ui};
use crate::templates::{TEMPLATES, Template};

/// Makes a folder with a commented scene, its meshes and study, to start from
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  glebe new field                      the full-size tillage scene: minutes on two cores
  glebe new field --quick              a coarse one: within a minute
  glebe new mill --template drum
  glebe new field --template sweep     a study: many variants of a scene
  glebe new sand --template rve        a study: triaxial tests on periodic samples
  glebe new soil --template calibration --quick     parameters that give what was measured")]
pub(super) struct Args {
    /// The folder to make
    name: PathBuf,
    /// What to start from
    #[arg(long, default_value = "tillage", value_parser = PossibleValuesParser::new(names()))]
    template: String,
    /// A size that ends in about a minute on two cores
    #[arg(long)]
    quick: bool,
}

fn names() -> Vec<PossibleValue> {
    TEMPLATES.iter().map(|t| PossibleValue::new(t.name).help(t.summary)).collect()
}

pub(super) fn run(args: &Args, ui: &Ui) -> Result<Ended, Problem> {
    let folder = &args.name;
    let failed = |e: &dyn std::fmt::Display| Problem::Failed(e.to_string());
    // The parser let only known names pass.
    let Some(template) = Template::named(&args.template) else {
        return Err(Problem::Input(format!("no template is called `{}`", args.template)));
    };
    if folder.symlink_metadata().is_ok() {
        return Err(Problem::Input(format!(
            "{} exists already, and nothing is overwritten: give another name",
            folder.display()
        )));
    }
    fs::create_dir_all(folder)
        .map_err(|e| Problem::Input(format!("the folder {} cannot be made: {e}", folder.display())))?;
    let files = template.write(folder, args.quick).map_err(|e| failed(&e))?;
    let (verb, file) = template.run_by();
    let value = json!({ "status": "ok", "folder": folder, "template": template.name, "files": files });
    let text = format!(
        "{}: {} ({})\nRun it:  glebe {verb} {}",
        folder.display(),
        template.summary,
        files.join(", "),
        shell_word(&folder.join(file).display().to_string())
    );
    ui.result(&value, &text);
    Ok(Ended::Done)
}
