//! Shapes and colours of the groups.

/// Okabe and Ito's palette on white, without yellow and with a darker purple: blue, vermilion, green, purple, orange,
/// sky, black.
const COLOURS: [&str; 7] = ["#0072b2", "#d55e00", "#009e73", "#aa4499", "#e69f00", "#56b4e9", "#333333"];
/// About the place of the mark: disc, square, triangle, diamond, triangle down, cross, bar.
const SHAPES: [&str; 7] = [
    "M-4.5 0a4.5 4.5 0 1 0 9 0a4.5 4.5 0 1 0 -9 0z",
    "M-4 -4h8v8h-8z",
    "M0 -5.2l5 9h-10z",
    "M0 -5.6l5.6 5.6l-5.6 5.6l-5.6 -5.6z",
    "M0 5.2l5 -9h-10z",
    "M-1.6 -5h3.2v3.4h3.4v3.2h-3.4v3.4h-3.2v-3.4h-3.4v-3.2h3.4z",
    "M-5.5 -2h11v4h-11z",
];

/// Colour of a group; the eighth begins again.
pub(in crate::report) fn colour(group: usize) -> &'static str {
    COLOURS[group % COLOURS.len()]
}

/// Returns the outline of a group's mark, relative to its place.
pub(super) fn shape(group: usize) -> &'static str {
    SHAPES[group % SHAPES.len()]
}
