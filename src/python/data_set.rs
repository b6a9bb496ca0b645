//! `DataSet`: items of a data set one by one, and whole folders.

use crate::errors::refused;
use crate::frame::{Drawn, Frame};
use core::sync::atomic::{AtomicBool, Ordering};
use data_sets::labels::{Filed, json_of};
use data_sets::{Item, Order, Spec, Studio, make};
use data_sets::{image_files::ImageFiles, spec::ImageForm};
use frames::sink::crc32::pixel_crc32;
use pyo3::prelude::*;
use serde_json::json;
use starloop::cli::version;
use std::path::PathBuf;
use std::sync::{Mutex, PoisonError};

/// A described data set.
#[pyclass(frozen)]
pub(crate) struct DataSet {
    spec: Spec,
    /// The camera of the latest shard.
    studio: Mutex<Option<Studio>>,
}

#[pymethods]
impl DataSet {
    /// Reads a description.
    #[staticmethod]
    fn open(path: PathBuf) -> PyResult<Self> {
        Ok(Self::of(Spec::read(&path).map_err(refused)?))
    }

    /// Reads the text of a description; files that it names are relative to `folder`.
    #[staticmethod]
    fn parse(text: &str, folder: PathBuf) -> PyResult<Self> {
        Ok(Self::of(Spec::parse(text, &folder).map_err(refused)?))
    }

    /// Returns the facts of the data set as JSON.
    fn facts(&self) -> String {
        json!({ "name": self.spec.name, "shard_items": self.spec.output.shard_items }).to_string()
    }

    /// Draws an item; returns it with its labels as JSON.
    fn item(&self, py: Python<'_>, number: u32) -> PyResult<(Frame, String)> {
        let (item, labels) = py.detach(|| self.drawn(number)).map_err(refused)?;
        Ok((Frame::new(py, Drawn::of(&item.frame))?, labels))
    }

    /// Draws a folder; returns what was made as JSON. Ctrl-C stops it in order.
    fn make(
        &self,
        py: Python<'_>,
        count: u32,
        folder: PathBuf,
        workers: Option<usize>,
        images: Option<&str>,
        shards: Option<(u32, u32)>,
    ) -> PyResult<String> {
        let mut spec = self.spec.clone();
        if let Some(form) = images {
            spec.output.images = ImageForm::parse(form).map_err(refused)?;
        }
        let workers = workers.unwrap_or_else(|| std::thread::available_parallelism().map_or(1, usize::from));
        let shards = shards.map(|(first, end)| first..end);
        let order = Order { spec: &spec, count, folder: &folder, shards, workers, program: version::SHORT };
        let (stop, mut interrupted) = (AtomicBool::new(false), Ok(()));
        let summary = py.detach(|| {
            make(&order, &stop, |_| {
                if let Err(signal) = Python::attach(|py| py.check_signals()) {
                    interrupted = Err(signal);
                    stop.store(true, Ordering::Relaxed);
                }
            })
        });
        interrupted?;
        let summary = summary.map_err(refused)?;
        let times = summary.times;
        Ok(json!({
            "folder": folder, "drawn": summary.drawn, "found": summary.found, "is_whole": summary.is_whole,
            "prepare_s": times.prepare_s, "draw_s": times.draw_s, "write_s": times.write_s,
        })
        .to_string())
    }
}

impl DataSet {
    fn of(spec: Spec) -> Self {
        Self { spec, studio: Mutex::default() }
    }

    fn drawn(&self, number: u32) -> Result<(Item, String), String> {
        let mut kept = self.studio.lock().unwrap_or_else(PoisonError::into_inner);
        let shard = self.spec.shard_of(number);
        let mut studio = match kept.take().filter(|studio| studio.shard == shard) {
            Some(studio) => studio,
            None => Studio::new(&self.spec, shard).map_err(|error| format!("{error:#}"))?,
        };
        let item = studio.item(number).map_err(|error| format!("{error:#}"));
        let drawn_keys = studio.drawn_keys.clone();
        *kept = Some(studio);
        let item = item?;
        let file = ImageFiles::place(self.spec.output.images, shard, number);
        let filed = Filed { item: &item, file: &file, crc32: pixel_crc32(&item.frame.image), drawn_keys: &drawn_keys };
        let labels = json_of(&filed).to_string();
        Ok((item, labels))
    }
}
