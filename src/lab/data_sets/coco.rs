//! Boxes and masks of targets in the form of COCO's object detection.
//!
//! In: the outlines of the items of a shard; at the end, the entries of all shards. Out: one JSON file that `pycocotools`
//! reads. Source: the data format page of the COCO project (cocodataset.org): images, annotations, categories; masks as run
//! lengths. An image's number is its item's; an annotation's follows from item and place, so that shards can be written
//! apart. Tests: below, and with pycocotools in `hil_scripts/tests/test_data_sets.py`.

use crate::{outline::Outline, studio::Item};
use serde_json::{Value, json};

/// The one category.
const TARGET: u32 = 1;
/// Annotations of one image that have numbers.
const MOST_OF_AN_IMAGE: u64 = 10_000;

/// Images and annotations of a shard.
#[derive(Debug, Default)]
pub struct Entries {
    images: Vec<Value>,
    annotations: Vec<Value>,
}

impl Entries {
    /// Adds an item; with masks where they are asked for, else with the corners of the boxes.
    pub fn push(&mut self, item: &Item, file: &str, has_masks: bool) {
        let image = &item.frame.image;
        let number = item.recipe.item;
        self.images.push(json!({
            "id": number,
            "file_name": file,
            "width": image.width(),
            "height": image.height(),
            "date_captured": item.frame.meta.mid_exposure.to_rfc3339(),
        }));
        for (place, outline) in (1..).zip(&item.outlines) {
            let id = u64::from(number) * MOST_OF_AN_IMAGE + place;
            self.annotations.push(annotation(outline, (id, number), [image.width(), image.height()], has_masks));
        }
    }

    /// Returns the entries as JSON.
    pub fn json(&self) -> Value {
        json!({ "images": self.images, "annotations": self.annotations })
    }
}

fn annotation(outline: &Outline, (id, image): (u64, u32), [width, height]: [usize; 2], has_masks: bool) -> Value {
    let [x, y, columns, rows] = outline.box_px;
    let [right, bottom] = [x + columns, y + rows];
    let segmentation = if has_masks {
        json!({ "size": [height, width], "counts": outline.runs })
    } else {
        json!([[x, y, right, y, right, bottom, x, bottom]])
    };
    let area_px = if has_masks { outline.area_px } else { columns * rows };
    json!({
        "id": id,
        "image_id": image,
        "category_id": TARGET,
        "bbox": outline.box_px,
        "area": area_px,
        "iscrowd": 0,
        "segmentation": segmentation,
        "truth_id": outline.id,
    })
}

/// Returns the whole file from the entries of all shards, in their order.
pub fn whole(name: &str, licence: &str, shards: impl Iterator<Item = Value>) -> Value {
    let (mut images, mut annotations) = (Vec::new(), Vec::new());
    for shard in shards {
        images.extend(shard["images"].as_array().cloned().unwrap_or_default());
        annotations.extend(shard["annotations"].as_array().cloned().unwrap_or_default());
    }
    json!({
        "info": { "description": name, "contributor": concat!("starloop ", env!("CARGO_PKG_VERSION")) },
        "licenses": [{ "id": 1, "name": licence }],
        "categories": [{ "id": TARGET, "name": "target", "supercategory": "space object" }],
        "images": images,
        "annotations": annotations,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn annotations_have_boxes_and_masks() {
        let outline = Outline { id: 9, box_px: [2, 3, 4, 5], area_px: 7, runs: vec![1, 7, 100] };
        let with = annotation(&outline, (50_001, 5), [12, 9], true);
        assert_eq!((&with["bbox"], &with["area"]), (&json!([2, 3, 4, 5]), &json!(7)));
        assert_eq!(with["segmentation"]["size"], json!([9, 12]), "rows first");
        let without = annotation(&outline, (50_001, 5), [12, 9], false);
        assert_eq!((&without["area"], &without["segmentation"][0][4]), (&json!(20), &json!(6)));
    }

    #[test]
    fn shards_are_joined_in_their_order() {
        let shard = |id: u32| json!({ "images": [{ "id": id }], "annotations": [] });
        let all = whole("n", "l", [shard(1), shard(2)].into_iter());
        assert_eq!(all["images"], json!([{ "id": 1 }, { "id": 2 }]));
        assert_eq!(all["categories"][0]["name"], json!("target"));
    }
}
