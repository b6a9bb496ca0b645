//! Names of benches, scenarios, cameras: what is printed and what becomes a folder.

use crate::{Bench, Camera, Document, Scenario};
use std::path::Path;

const CAMERA: &str =
    "[detector]\nwidth_px = 64\nheight_px = 64\npixel_pitch_um = 10.0\n[optics]\nfocal_length_mm = 50.0\n";

fn bench(name: &str) -> Result<Bench, String> {
    let text = format!("name = {name:?}\n");
    Bench::from_document(&Document::from_text(&text, Path::new("b.toml"))).map_err(|error| error.to_string())
}

#[test]
fn name_that_leads_out_of_the_output_folder_is_refused() {
    for name in ["../../escaped", "a/b", "/etc", "..", ".", "a\\b"] {
        let error = bench(name).unwrap_err();
        assert!(error.contains("b.toml:1: name is ") && error.contains("a name without /"), "{name}: {error}");
    }
    for name in ["plain", "20 deg, 10 Hz", "..hidden", "Größe"] {
        assert_eq!(bench(name).unwrap().name, name, "control");
    }
    let scenario = Document::from_text("name = \"../x\"\n", Path::new("s.toml"));
    let error = Scenario::from_document(&scenario).unwrap_err().to_string();
    assert!(error.contains("s.toml:1: name is \"../x\""), "{error}");
}

#[test]
fn control_characters_in_a_name_are_refused_and_escaped_in_the_message() {
    for name in ["\\u001b[2J", "bell\\u0007", "two\\nlines", " ", ""] {
        let text = format!("name = \"{name}\"\n");
        let error = Bench::from_document(&Document::from_text(&text, Path::new("b.toml"))).unwrap_err().to_string();
        assert!(error.contains("printable characters") && !error.chars().any(char::is_control), "{error:?}");
        let error = Camera::from_document(&Document::from_text(&format!("{text}{CAMERA}"), Path::new("c.toml")));
        assert!(error.unwrap_err().to_string().contains("c.toml:1: name is "));
    }
    let slash = format!("name = \"CMV4000 / 50 mm\"\n{CAMERA}");
    Camera::from_document(&Document::from_text(&slash, Path::new("c.toml"))).expect("no folder is named by a camera");
    let error = bench(&"x".repeat(5000)).unwrap_err();
    assert!(error.len() < 300, "{error}");
}
