//! Every law has a page under `docs/laws`, whose head and table are those of the registry. `GLEBE_WRITE_PAGES=1` writes
//! them anew and leaves what people wrote below.

// Clippy's permission for tests does not reach their helpers.
#![allow(clippy::unwrap_used)]

use std::fmt::Write as _;
use std::fs;
use std::path::PathBuf;

use glebe_physics::{LawInfo, Slot, laws};

/// What stands above the text of a page.
const END: &str = "<!-- Above: from the registry, see crates/physics/tests/pages.rs. Below: by hand. -->\n";

fn folder() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../docs/laws")
}

fn file(slot: Slot, law: &LawInfo) -> String {
    format!("{}-{}.md", slot.name(), law.name)
}

fn described() -> impl Iterator<Item = (Slot, &'static LawInfo)> {
    Slot::ALL.into_iter().flat_map(|slot| laws(slot).iter().map(move |law| (slot, law)))
}

fn head(slot: Slot, law: &LawInfo) -> String {
    let mut text = format!("# {}: {}\n\n{}.\n", slot.name(), law.name, capital(law.summary));
    if !law.source.is_empty() {
        write!(text, "\nSource: {}.\n", law.source).unwrap();
    }
    let slot = slot.name();
    if law.parameters.is_empty() {
        write!(text, "\n```toml\n[contact]\n{slot} = \"{}\"\n```\n", law.name).unwrap();
    } else {
        write!(text, "\n```toml\n[contact.{slot}.{}]\n", law.name).unwrap();
        for p in law.parameters {
            writeln!(text, "{} = {}", p.name, shown(p.typical)).unwrap();
        }
        text += "```\n\n| parameter | unit | left out | least | typical | |\n|---|---|---|---|---|---|\n";
        for p in law.parameters {
            let unit = if p.unit.is_empty() { "-" } else { p.unit };
            let default = match p.default {
                Some(x) => shown(x),
                None if p.required => "required".to_owned(),
                None => "see right".to_owned(),
            };
            let least = if p.min == f64::MIN_POSITIVE { "above 0".to_owned() } else { shown(p.min) };
            let (name, typical) = (p.name, shown(p.typical));
            writeln!(text, "| `{name}` | {unit} | {default} | {least} | {typical} | {} |", p.summary)
                .unwrap();
        }
    }
    text + "\n" + END
}

fn shown(x: f64) -> String {
    if x == 0.0 || (1e-3..1e3).contains(&x) { format!("{x:?}") } else { format!("{x:e}") }
}

fn capital(text: &str) -> String {
    let mut letters = text.chars();
    letters.next().map_or_else(String::new, |first| first.to_uppercase().chain(letters).collect())
}

fn index() -> String {
    let mut text = "# Contact laws\n\nA contact has a law in each of four slots: `normal`, `tangential`, `rolling` and \
                    `cohesion`. Their forces add up. In all\npages δ is the overlap, positive in touch, R* and m* the \
                    effective radius and mass (of a wall those of the particle),\nE* and G* the effective moduli of the \
                    pair, μ, μr and e its friction, rolling friction and restitution.\n\nWhat coheres may be chosen by \
                    pair: `pair.soil-steel.cohesion = 0` takes cohesion and adhesion from contacts of soil and\nsteel, \
                    any other factor makes them stronger or weaker. Energy that yielding contacts, adhesion and bridges \
                    take stands in\nthe row `friction` of the energy ledger, that of slipping rolling springs in \
                    `rolling`.\n\nA pair of materials may also have laws of its own. Slots that it leaves out have \
                    the law of `[contact]`, and so have all other\npairs:\n\n```toml\n[contact]\nnormal = \"hertz\"\n\n\
                    [pair.soil-soil.contact]\nnormal = { eepa = { plasticity = 0.6, adhesion = 0.3 } }\nrolling = \
                    \"epsd\"\n```\n\nThe CPU takes any number of laws. On a device a world has at most two laws in \
                    each slot; `glebe check --device` says so\nwhere there are more. What all pairs remember together \
                    has to fit into 12 numbers per contact.\n\nParticles may be bonded \
                    besides (`contact.bond`): a stage with `bond = true` makes the bonds.\n"
        .to_owned();
    for slot in Slot::ALL {
        write!(text, "\n## {}\n\n| law | |\n|---|---|\n", slot.name()).unwrap();
        for law in laws(slot) {
            writeln!(text, "| [`{}`]({}) | {} |", law.name, file(slot, law), law.summary).unwrap();
        }
    }
    text
}

#[test]
fn every_law_has_its_page() {
    let write = std::env::var_os("GLEBE_WRITE_PAGES").is_some();
    if write {
        fs::create_dir_all(folder()).unwrap();
        fs::write(folder().join("README.md"), index()).unwrap();
    }
    let hint = "; GLEBE_WRITE_PAGES=1 writes what follows from the registry";
    assert_eq!(fs::read_to_string(folder().join("README.md")).unwrap(), index(), "docs/laws/README.md{hint}");
    for (slot, law) in described() {
        let path = folder().join(file(slot, law));
        let page = fs::read_to_string(&path).unwrap_or_default();
        let body = page.split_once(END).map_or("", |(_, body)| body).to_owned();
        if write {
            fs::write(&path, head(slot, law) + &body).unwrap();
        } else {
            assert!(
                page.starts_with(&head(slot, law)),
                "{} is not that of the registry{hint}",
                path.display()
            );
        }
        if law.name != "none" {
            for part in ["## Equation", "## Limits"] {
                assert!(write || body.contains(part), "{} has no part `{part}`", path.display());
            }
        }
    }
    let pages =
        fs::read_dir(folder()).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap());
    let known: Vec<String> = described().map(|(slot, law)| file(slot, law)).collect();
    for page in pages.filter(|page| page != "README.md") {
        assert!(known.contains(&page), "docs/laws/{page} is of no law");
    }
}
