// Pixels that differ from their neighbours in this frame: `Outlier` of `outliers.rs`, sorted by pixel.
// The first element's `pixel` is the number of those that follow.

struct Outlier {
    pixel: u32,
    response: f32,
    dark_e: f32,
    charge_e: f32,
}

struct PairOutliers {
    response: vec2<f32>,
    dark_e: vec2<f32>,
    charge_e: vec2<f32>,
}

// Returns the outliers of the two pixels of a pair.
fn pair_outliers(pair: u32) -> PairOutliers {
    var found = PairOutliers(vec2<f32>(1.0), vec2<f32>(0.0), vec2<f32>(0.0));
    let count = outliers[0].pixel;
    if (count == 0u) {
        return found;
    }
    var low = 1u;
    var high = count + 1u;
    while (low < high) {
        let middle = (low + high) / 2u;
        if (outliers[middle].pixel < 2u * pair) {
            low = middle + 1u;
        } else {
            high = middle;
        }
    }
    for (var i = low; i <= min(low + 1u, count); i += 1u) {
        let outlier = outliers[i];
        if (outlier.pixel == 2u * pair) {
            found.response.x = outlier.response;
            found.dark_e.x = outlier.dark_e;
            found.charge_e.x = outlier.charge_e;
        } else if (outlier.pixel == 2u * pair + 1u) {
            found.response.y = outlier.response;
            found.dark_e.y = outlier.dark_e;
            found.charge_e.y = outlier.charge_e;
        }
    }
    return found;
}
