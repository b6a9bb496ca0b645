//! The stars of a frame as JSON, for the page to draw over its picture.
//!
//! In: a frame. Out: the brightest [`STARS_MAX`] by electrons, with how many there are. Positions: px, the first
//! pixel's centre is (0, 0). Test: below.

use frames::sink::SentFrame;
use serde_json::{Value, json};

/// Number of stars reported of one frame.
pub(super) const STARS_MAX: usize = 400;

/// Returns number, size and stars of a frame.
pub(super) fn truth_of(frame: &SentFrame) -> Value {
    let mut order: Vec<usize> = (0..frame.truth.len()).collect();
    order.sort_by(|a, b| frame.truth[*b].electrons.total_cmp(&frame.truth[*a].electrons));
    let stars: Vec<Value> = order
        .iter()
        .take(STARS_MAX)
        .map(|i| {
            let star = &frame.truth[*i];
            json!({
                "id": star.id,
                "source_id": star.source_id.map(|id| id.to_string()),
                "kind": star.kind.name(),
                "x_px": star.x_px,
                "y_px": star.y_px,
                "apparent_ra_deg": star.apparent_deg[0],
                "apparent_dec_deg": star.apparent_deg[1],
                "catalog_ra_deg": star.catalog_deg[0],
                "catalog_dec_deg": star.catalog_deg[1],
                "mag": star.mag,
                "electrons": star.electrons,
                "smear_px": star.smear_px,
                "smear_deg": star.smear_deg,
            })
        })
        .collect();
    json!({
        "frame": frame.meta.number,
        "size_px": [frame.image.width(), frame.image.height()],
        "stars_in_frame": frame.truth.len(),
        "stars": stars,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use base::source_id::{GaiaRelease, SourceId};
    use frames::sink::TruthStar;

    #[test]
    fn the_brightest_come_first_and_the_rest_is_counted() {
        let mut frame = SentFrame::with_capacity(8, 6, 500, "c".into());
        let star = |i: u32| TruthStar {
            id: i,
            electrons: f64::from(i * 7_919 % 500),
            x_px: 1.25,
            smear_px: 24.5,
            source_id: (i != 498).then(|| SourceId::Gaia(GaiaRelease::Dr3, 4_000_000_000_000_000_000 + u64::from(i))),
            ..TruthStar::NONE
        };
        frame.truth.extend((0..500).map(star));
        frame.truth[3].electrons = f64::NAN;
        let truth = truth_of(&frame);
        assert_eq!((&truth["stars_in_frame"], &truth["size_px"]), (&json!(500), &json!([8, 6])));
        let stars = truth["stars"].as_array().unwrap();
        let electrons: Vec<f64> = stars.iter().filter_map(|star| star["electrons"].as_f64()).collect();
        assert_eq!((stars.len(), stars[1]["electrons"].as_f64()), (STARS_MAX, Some(499.0)));
        assert!(electrons.windows(2).all(|pair| pair[0] >= pair[1]) && electrons.len() == STARS_MAX - 1);
        assert_eq!((&stars[1]["x_px"], &stars[1]["kind"]), (&json!(1.25), &json!("star")));
        let of_id = |id: u32| stars.iter().find(|star| star["id"] == id).map(|star| star["source_id"].clone());
        let name = frame.truth[497].source_id.map(|id| id.to_string());
        assert_eq!(
            (of_id(497), of_id(498)),
            (Some(json!(name)), Some(json!(null))),
            "text: no number keeps its digits"
        );
        assert_eq!((&stars[1]["smear_px"], &stars[1]["catalog_ra_deg"]), (&json!(24.5), &json!(0.0)));
    }
}
