//! The description of a data set: a TOML file that says what is drawn, from which distributions, into which files.
//!
//! In: the file. Out: checked tables ([`Spec`]). Cameras and benches are read when a shard is begun, because their keys may
//! be drawn. The keys are listed in the guide's `data_sets.md`. Tests: below.

use crate::attitudes::{AttitudeKeys, Attitudes};
use crate::distribution;
use anyhow::{Context, Result, bail};
use base::input_file::{SETTINGS_BYTES, read_text};
use base::time::Tai;
use batch::still::{DEFAULT_TIME, MOST_DEG_PER_S};
use serde::Deserialize;
use std::path::{Path, PathBuf};
use toml::{Table, Value};

/// Descriptions that come with the program, by their paths below `configs/`.
const BUILT_IN: [(&str, &str); 2] = [
    ("data_sets/lost_in_space.toml", include_str!("../../../configs/data_sets/lost_in_space.toml")),
    ("data_sets/targets.toml", include_str!("../../../configs/data_sets/targets.toml")),
];
/// Most items of a shard.
const MOST_SHARD_ITEMS: u32 = 100_000;
/// Most positions of a drawn jitter.
const MOST_POSITIONS: u32 = 4096;
/// Most targets or faults that one item may draw from one entry.
pub const MOST_OF_AN_ENTRY: i64 = 64;

/// A description as its file gives it.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
struct Keys {
    name: String,
    #[serde(default)]
    description: String,
    #[serde(default = "no_licence")]
    licence: String,
    #[serde(default = "first_seed")]
    seed: u64,
    camera: PathBuf,
    bench: Option<PathBuf>,
    #[serde(default)]
    attitude: AttitudeKeys,
    #[serde(default)]
    time: TimeKeys,
    #[serde(default)]
    motion: MotionKeys,
    #[serde(default)]
    fault: Vec<Table>,
    #[serde(default)]
    target: Vec<Table>,
    #[serde(default)]
    draw: DrawKeys,
    #[serde(default)]
    output: OutputKeys,
}

#[derive(Debug, Clone, PartialEq, Default, Deserialize)]
#[serde(default, deny_unknown_fields)]
struct TimeKeys {
    from_utc: Option<String>,
    to_utc: Option<String>,
}

/// The table `[motion]`: what moves within the exposure.
#[derive(Debug, Clone, PartialEq, Default, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct MotionKeys {
    /// Three numbers about the sensor's axes, or one number about a random axis, deg/s; distributions allowed.
    pub rate_deg_s: Option<Value>,
    /// Standard deviation of the line of sight's positions, each axis, arcsec; a distribution is allowed.
    pub jitter_arcsec: Option<Value>,
    /// Independent positions of equal weight within the exposure.
    pub jitter_positions: Option<u32>,
}

/// The table `[draw]`: keys of the camera and the bench that change from shard to shard.
#[derive(Debug, Clone, PartialEq, Default, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct DrawKeys {
    /// Dotted keys of the camera file and their distributions.
    pub camera: Table,
    /// Dotted keys of the bench and their distributions.
    pub bench: Table,
}

/// The table `[output]`.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct OutputKeys {
    /// Form of the images.
    pub images: ImageForm,
    /// Items of a shard, which share one drawn camera and bench.
    pub shard_items: u32,
    /// True with masks of targets beside their boxes.
    pub masks: bool,
    /// A pixel is a target's when its light there is at least this many times the noise of the pixel without it.
    pub mask_snr: f64,
}

impl Default for OutputKeys {
    fn default() -> Self {
        Self { images: ImageForm::Fits, shard_items: 250, masks: false, mask_snr: 1.0 }
    }
}

/// Forms of images.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ImageForm {
    /// FITS, Rice-compressed, a file for each item.
    Fits,
    /// PNG of 16 bits, a file for each item.
    Png,
    /// WebDataset: a tar file for each shard, with PNG and JSON of each item.
    Webdataset,
    /// Zarr, version 3: one array of all images.
    Zarr,
}

impl ImageForm {
    /// Every form with its name.
    pub const NAMED: [(Self, &'static str); 4] =
        [(Self::Fits, "fits"), (Self::Png, "png"), (Self::Webdataset, "webdataset"), (Self::Zarr, "zarr")];

    /// Returns the form of a name.
    ///
    /// # Errors
    /// When no form has this name.
    pub fn parse(text: &str) -> Result<Self> {
        let found = Self::NAMED.iter().find(|(_, name)| *name == text);
        found.map(|(form, _)| *form).with_context(|| format!("got \"{text}\", wanted fits, png, webdataset or zarr"))
    }

    /// Returns its name.
    pub fn name(self) -> &'static str {
        Self::NAMED.iter().find(|(form, _)| *form == self).map_or("", |(_, name)| name)
    }
}

/// A fault that some items have.
#[derive(Debug, Clone, PartialEq)]
pub struct FaultDraw {
    /// Share of items that have it.
    pub probability: f64,
    /// Keys of an event, with distributions.
    pub keys: Table,
}

/// Targets that items have.
#[derive(Debug, Clone, PartialEq)]
pub struct TargetDraw {
    /// How many: a whole number, or a distribution of whole numbers.
    pub count: Value,
    /// Keys of a target, with distributions.
    pub keys: Table,
}

/// A checked description.
#[derive(Debug, Clone, PartialEq)]
pub struct Spec {
    /// Its name.
    pub name: String,
    /// Its purpose.
    pub description: String,
    /// Licence of the images.
    pub licence: String,
    /// Seed of everything that is drawn.
    pub seed: u64,
    /// Camera file, or the name of a built-in one.
    pub camera: PathBuf,
    /// Bench with observer, bodies, targets, layers of stars and accuracy.
    pub bench: Option<PathBuf>,
    /// Attitudes to take items from.
    pub attitudes: Attitudes,
    /// First and last middle of an exposure.
    pub span: [Tai; 2],
    /// Motion within the exposure.
    pub motion: MotionKeys,
    /// Faults that some items have.
    pub faults: Vec<FaultDraw>,
    /// Targets that items have.
    pub targets: Vec<TargetDraw>,
    /// Keys that change from shard to shard.
    pub draw: DrawKeys,
    /// Files.
    pub output: OutputKeys,
    /// The text of the file.
    pub text: String,
}

fn no_licence() -> String {
    "not stated".into()
}

fn first_seed() -> u64 {
    1
}

impl Spec {
    /// Reads a description; where the file is missing, the one of the program with this path below `configs/`. Files
    /// that it names are relative to its folder.
    ///
    /// # Errors
    /// With the file, what was got and what was wanted.
    pub fn read(path: &Path) -> Result<Self> {
        let name = || path.display().to_string();
        let below_configs = path.strip_prefix("configs").unwrap_or(path);
        let built_in = BUILT_IN.iter().find(|(known, _)| Path::new(known) == below_configs && !path.exists());
        if let Some((_, text)) = built_in {
            return Self::parse(text, Path::new(".")).with_context(name);
        }
        let known = || format!("{}; built in are {}", name(), BUILT_IN.map(|(known, _)| known).join(", "));
        let text = read_text(path, SETTINGS_BYTES).with_context(known)?;
        Self::parse(&text, path.parent().unwrap_or(Path::new("."))).with_context(name)
    }

    /// Checks the text of a description; files that it names are relative to `folder`.
    ///
    /// # Errors
    /// With what was got and what was wanted.
    pub fn parse(text: &str, folder: &Path) -> Result<Self> {
        let keys: Keys = toml::from_str(text)?;
        let attitudes = keys.attitude.check(folder).context("attitude")?;
        let span = keys.time.check().context("time")?;
        keys.motion.check().context("motion")?;
        keys.output.check().context("output")?;
        for (table, name) in [(&keys.draw.camera, "draw.camera"), (&keys.draw.bench, "draw.bench")] {
            table
                .iter()
                .try_for_each(|(key, value)| distribution::check(value).with_context(|| format!("{name}.{key}")))?;
        }
        let fault = |(number, table): (usize, Table)| fault(table).with_context(|| format!("fault[{number}]"));
        let target = |(number, table): (usize, Table)| target(table).with_context(|| format!("target[{number}]"));
        Ok(Self {
            name: keys.name,
            description: keys.description,
            licence: keys.licence,
            seed: keys.seed,
            camera: beside(folder, &keys.camera),
            bench: keys.bench.map(|bench| beside(folder, &bench)),
            attitudes,
            span,
            motion: keys.motion,
            faults: keys.fault.into_iter().enumerate().map(fault).collect::<Result<_>>()?,
            targets: keys.target.into_iter().enumerate().map(target).collect::<Result<_>>()?,
            draw: keys.draw,
            output: keys.output,
            text: text.into(),
        })
    }

    /// Returns the shard of an item.
    pub fn shard_of(&self, item: u32) -> u32 {
        item / self.output.shard_items
    }

    /// Returns the number of shards of this many items.
    pub fn shards(&self, count: u32) -> u32 {
        count.div_ceil(self.output.shard_items)
    }

    /// Returns the items of a shard in a data set of `count`.
    pub fn items_of(&self, shard: u32, count: u32) -> core::ops::Range<u32> {
        let first = shard.saturating_mul(self.output.shard_items);
        first..first.saturating_add(self.output.shard_items).min(count)
    }
}

/// Returns a file beside the description where there is one, else the name itself, which may be a built-in one.
fn beside(folder: &Path, name: &Path) -> PathBuf {
    let there = folder.join(name);
    if there.exists() { there } else { name.into() }
}

impl TimeKeys {
    fn check(&self) -> Result<[Tai; 2]> {
        let read = |text: &str, key| Tai::from_rfc3339(text).with_context(|| format!("{key}: got \"{text}\""));
        let from = read(self.from_utc.as_deref().unwrap_or(DEFAULT_TIME), "from_utc")?;
        let to = self.to_utc.as_deref().map_or(Ok(from), |text| read(text, "to_utc"))?;
        if to < from { bail!("to_utc: got an instant before from_utc, wanted one after it") } else { Ok([from, to]) }
    }
}

impl MotionKeys {
    fn check(&self) -> Result<()> {
        for (value, name) in [(&self.rate_deg_s, "rate_deg_s"), (&self.jitter_arcsec, "jitter_arcsec")] {
            value.iter().try_for_each(distribution::check).context(name)?;
        }
        if let Some(list) = self.rate_deg_s.as_ref().and_then(Value::as_array)
            && list.len() != 3
        {
            bail!("rate_deg_s: got {} numbers, wanted three, or one about a random axis", list.len());
        }
        match self.jitter_positions {
            Some(positions) if positions == 0 || positions > MOST_POSITIONS => {
                bail!("jitter_positions: got {positions}, wanted 1 to {MOST_POSITIONS}")
            }
            Some(_) if self.jitter_arcsec.is_none() => bail!("jitter_positions: wanted it with jitter_arcsec only"),
            Some(_) | None => Ok(()),
        }
    }

    /// Checks a drawn rate, deg/s.
    ///
    /// # Errors
    /// When nothing turns as fast.
    pub fn check_rate(norm_deg_s: f64) -> Result<()> {
        let is_good = norm_deg_s <= MOST_DEG_PER_S;
        if is_good { Ok(()) } else { bail!("rate_deg_s: drew {norm_deg_s}, wanted at most {MOST_DEG_PER_S}") }
    }
}

impl OutputKeys {
    fn check(&self) -> Result<()> {
        if self.shard_items == 0 || self.shard_items > MOST_SHARD_ITEMS {
            bail!("shard_items: got {}, wanted 1 to {MOST_SHARD_ITEMS}", self.shard_items);
        }
        if !(1e-3..=1e3).contains(&self.mask_snr) {
            bail!("mask_snr: got {}, wanted 0.001 to 1000", self.mask_snr);
        }
        Ok(())
    }
}

fn fault(mut keys: Table) -> Result<FaultDraw> {
    let probability = match keys.remove("probability") {
        None => 1.0,
        Some(value) => distribution::number_of(&value)
            .filter(|share| (0.0..=1.0).contains(share))
            .with_context(|| format!("probability: got {value}, wanted 0 to 1"))?,
    };
    distribution::check(&Value::Table(keys.clone()))?;
    if keys.contains_key("do") { Ok(FaultDraw { probability, keys }) } else { bail!("do is missing; wanted a fault") }
}

fn target(mut keys: Table) -> Result<TargetDraw> {
    let count = keys.remove("count").unwrap_or(Value::Integer(1));
    distribution::check(&count).context("count")?;
    if let Some(whole) = count.as_integer()
        && !(0..=MOST_OF_AN_ENTRY).contains(&whole)
    {
        bail!("count: got {whole}, wanted 0 to {MOST_OF_AN_ENTRY}");
    }
    distribution::check(&Value::Table(keys.clone()))?;
    Ok(TargetDraw { count, keys })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parsed(rest: &str) -> Result<Spec> {
        Spec::parse(&format!("name = \"x\"\ncamera = \"cameras/small_tracker.toml\"\n{rest}"), Path::new("."))
    }

    #[test]
    fn shards_cover_every_item_once() {
        let spec = parsed("[output]\nshard_items = 100\n").unwrap();
        let items: Vec<u32> = (0..spec.shards(250)).flat_map(|shard| spec.items_of(shard, 250)).collect();
        assert_eq!(items, (0..250).collect::<Vec<_>>());
        assert!((0..250).all(|item| spec.items_of(spec.shard_of(item), 250).contains(&item)));
        assert_eq!((spec.shards(0), spec.shards(100), spec.shards(101)), (0, 1, 2));
    }

    #[test]
    fn built_in_descriptions_are_read_by_their_names() {
        for (name, _) in BUILT_IN {
            assert!(Spec::read(Path::new(name)).is_ok(), "{name}");
        }
        let error = format!("{:#}", Spec::read(Path::new("data_sets/none.toml")).unwrap_err());
        assert!(error.contains("data_sets/none.toml") && error.contains("lost_in_space"), "{error}");
    }

    #[test]
    fn forms_read_their_names() {
        for (form, name) in ImageForm::NAMED {
            assert_eq!(ImageForm::parse(name).unwrap(), form);
            assert_eq!(form.name(), name);
        }
        assert!(ImageForm::parse("jpeg").unwrap_err().to_string().contains("jpeg"));
    }

    #[test]
    fn wrong_keys_are_refused_with_their_place() {
        let refused = |rest: &str| format!("{:#}", parsed(rest).unwrap_err());
        for (rest, wanted) in [
            ("colour = 1\n", "colour"),
            ("[time]\nfrom_utc = \"2026-01-02\"\nto_utc = \"2026-01-01\"\n", "time: to_utc"),
            ("[time]\nfrom_utc = \"soon\"\n", "from_utc: got \"soon\""),
            ("[motion]\nrate_deg_s = [1, 2]\n", "motion: rate_deg_s: got 2"),
            ("[motion]\njitter_positions = 3\n", "with jitter_arcsec only"),
            ("[motion]\njitter_arcsec = 1\njitter_positions = 0\n", "jitter_positions: got 0"),
            ("[output]\nshard_items = 0\n", "output: shard_items"),
            ("[output]\nimages = \"jpeg\"\n", "jpeg"),
            ("[[fault]]\nprobability = 2\ndo = \"frame_blank\"\n", "fault[0]: probability: got 2"),
            ("[[fault]]\ne_per_s = 2\n", "do is missing"),
            ("[[target]]\ncount = 100\n", "target[0]: count: got 100"),
            ("[draw.camera]\n\"a.b\" = { uniform = [2, 1] }\n", "draw.camera.a.b: uniform"),
        ] {
            assert!(refused(rest).contains(wanted), "{rest}: {}", refused(rest));
        }
    }
}
