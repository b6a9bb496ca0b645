//! `starloop --version`: version, commit, features, target.

/// Version and commit, on one line.
pub const SHORT: &str = concat!(env!("CARGO_PKG_VERSION"), " (", env!("STARLOOP_COMMIT"), ")");
/// Commit that the program was built from; "unknown" when built outside a repository.
pub(crate) const COMMIT: &str = env!("STARLOOP_COMMIT");
/// Processor and system that the program was built for.
pub(crate) const TARGET: &str = env!("STARLOOP_TARGET");

/// Returns the optional features that the program was built with.
pub(crate) fn features() -> Vec<&'static str> {
    let all = [
        ("data_sets", cfg!(feature = "data_sets")),
        ("display", cfg!(feature = "display")),
        ("hats", cfg!(feature = "hats")),
        ("iceoryx2", cfg!(feature = "iceoryx2")),
        ("parquet", cfg!(feature = "parquet")),
        ("spice", cfg!(feature = "spice")),
    ];
    all.into_iter().filter(|(_, is_built)| *is_built).map(|(name, _)| name).collect()
}

/// Returns the text of `--version`, without the program's name.
pub(crate) fn long() -> String {
    let features = features();
    let features = if features.is_empty() { "none".into() } else { features.join(", ") };
    format!("{}\ncommit    {COMMIT}\nfeatures  {features}\ntarget    {TARGET}", env!("CARGO_PKG_VERSION"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_feature_of_the_manifest_is_listed_when_it_is_built() {
        let manifest = include_str!("../../Cargo.toml");
        let section = manifest.split("[features]").nth(1).unwrap().split("\n[").next().unwrap();
        let names =
            section.lines().filter_map(|line| line.split_once(" = ")).filter(|(name, _)| !name.starts_with('#'));
        // Names for several of them.
        let is_one = |name: &&str| !matches!(*name, "default" | "full");
        let names: Vec<_> = names.map(|(name, _)| name.trim()).filter(is_one).collect();
        assert!(names.len() >= 6, "{names:?}");
        let source = include_str!("version.rs");
        for name in names {
            assert!(source.contains(&format!("(\"{name}\", cfg!")), "feature {name} is not in features()");
        }
    }

    #[test]
    fn the_long_text_begins_with_the_version_and_names_the_commit() {
        let text = long();
        assert!(text.starts_with(env!("CARGO_PKG_VERSION")) && text.contains(COMMIT), "{text}");
        assert!(SHORT.contains(COMMIT) && !COMMIT.is_empty());
    }
}
