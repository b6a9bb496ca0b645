//! A PSF that depends on the place in the field: PSFs at the nodes of a grid, and between them their bilinear blend.
//!
//! In: PSFs of any model at `columns x rows` nodes, evenly spaced from one edge of the detector to the other (the first
//! at -1/2 px, the last at size - 1/2), row by row. Out: the four nodes about a place with their shares, or the blend's
//! pixel integral. A star has the PSF of its mean place throughout its exposure. The maker of the field must know the
//! error of the bilinear blend: for a PSF that changes smoothly it falls with the square of the cells' size. Tests
//! below; `tests/physics/psf_field.rs` compares drawn images with the blend.

use crate::optics::psf::PsfModel;
use base::refused::Refused;

/// Largest number of nodes along each side.
pub const MOST_NODES: usize = 9;

/// PSFs over a detector.
#[derive(Debug, Clone, PartialEq)]
pub struct PsfField {
    cells: [usize; 2],
    size_px: [f64; 2],
    nodes: Vec<PsfModel>,
}

impl PsfField {
    /// Returns a field of nodes along a row and a column of a detector of `size_px`, with `psfs` row by row from the
    /// top left.
    ///
    /// # Errors
    /// When there are too few or too many nodes, or another number of PSFs, or a node is a field.
    pub fn new([columns, rows]: [usize; 2], size_px: [usize; 2], psfs: Vec<PsfModel>) -> Result<Self, Refused> {
        let allowed = 2..=MOST_NODES;
        if !allowed.contains(&columns) || !allowed.contains(&rows) {
            return Err(Refused(format!(
                "PSF field: {columns} x {rows} nodes, wanted 2 to {MOST_NODES} along each side \
                 (one PSF for all places needs no field)"
            )));
        }
        if psfs.len() != columns * rows {
            return Err(Refused(format!(
                "PSF field: {got} PSFs for {columns} x {rows} nodes, wanted one for each",
                got = psfs.len()
            )));
        }
        if let Some(node) = psfs.iter().position(|psf| psf.as_field().is_some()) {
            return Err(Refused(format!("PSF field: node {node} is a field itself, wanted a PSF for one place")));
        }
        Ok(Self { cells: [columns - 1, rows - 1], size_px: size_px.map(|n| n as f64), nodes: psfs })
    }

    /// Returns the number of cells between the nodes along a row and a column.
    pub fn cells(&self) -> [usize; 2] {
        self.cells
    }

    /// Returns the PSFs at the nodes, row by row.
    pub fn nodes(&self) -> &[PsfModel] {
        &self.nodes
    }

    /// Returns the place of a node, px.
    pub fn place_px(&self, node: usize) -> [f64; 2] {
        let columns = self.cells[0] + 1;
        self.corner_px([node % columns, node / columns])
    }

    /// Returns the four nodes about a place (top left, top right, bottom left, bottom right) and their shares, which
    /// sum to 1. Places off the detector have those of the edge.
    pub fn around(&self, px: [f64; 2]) -> [(usize, f64); 4] {
        let cell: [usize; 2] = core::array::from_fn(|i| {
            #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to the cells")]
            let cell = ((px[i] + 0.5) / self.size_px[i] * self.cells[i] as f64).clamp(0.0, self.cells[i] as f64 - 1.0)
                as usize;
            cell
        });
        let (origin, end) = (self.corner_px(cell), self.corner_px(cell.map(|v| v + 1)));
        let [x, y] = core::array::from_fn(|i| ((px[i] - origin[i]) / (end[i] - origin[i])).clamp(0.0, 1.0));
        let columns = self.cells[0] + 1;
        let first = cell[1] * columns + cell[0];
        [
            (first, (1.0 - x) * (1.0 - y)),
            (first + 1, x * (1.0 - y)),
            (first + columns, (1.0 - x) * y),
            (first + columns + 1, x * y),
        ]
    }

    /// Returns the share of the light of a star at `star_px` in the pixel whose centre lies (`x_px`, `y_px`) from it.
    pub fn pixel(&self, star_px: [f64; 2], x_px: f64, y_px: f64) -> f64 {
        let nodes = self.around(star_px).into_iter().filter(|(_, share)| *share > 0.0);
        nodes.map(|(node, share)| share * self.nodes[node].pixel(x_px, y_px)).sum()
    }

    /// Returns the middle of the detector, px.
    pub fn middle_px(&self) -> [f64; 2] {
        self.size_px.map(|size| 0.5 * (size - 1.0))
    }

    fn corner_px(&self, at: [usize; 2]) -> [f64; 2] {
        core::array::from_fn(|i| at[i] as f64 / self.cells[i] as f64 * self.size_px[i] - 0.5)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn field() -> PsfField {
        PsfField::new([3, 2], [200, 100], (0..6).map(|i| PsfModel::gaussian(0.5 + 0.1 * f64::from(i))).collect())
            .unwrap()
    }

    #[test]
    fn nodes_lie_at_the_edges_and_shares_are_bilinear() {
        let field = field();
        assert_eq!(
            [0, 1, 2, 5].map(|node| field.place_px(node)),
            [[-0.5, -0.5], [99.5, -0.5], [199.5, -0.5], [199.5, 99.5]]
        );
        for node in 0..6 {
            let at_node = field.around(field.place_px(node));
            let (found, share) = at_node.into_iter().max_by(|a, b| a.1.total_cmp(&b.1)).unwrap();
            assert_eq!((found, share), (node, 1.0), "{at_node:?}");
        }
        // A quarter into the second cell, three quarters down.
        let around = field.around([124.5, 74.5]);
        for ((node, share), wanted) in around.into_iter().zip([(1, 0.1875), (2, 0.0625), (4, 0.5625), (5, 0.1875)]) {
            assert!(node == wanted.0 && (share - wanted.1).abs() < 1e-12, "{around:?}");
        }
        // Off the detector: the edge.
        assert_eq!(field.around([-40.0, 200.0]), field.around([-0.5, 99.5]));
    }

    #[test]
    fn pixels_are_blended() {
        let field = field();
        let [a, b] = [PsfModel::gaussian(0.5), PsfModel::gaussian(0.6)].map(|psf| psf.pixel(1.0, -0.3));
        let got = field.pixel([24.5, -0.5], 1.0, -0.3);
        assert!((got - 0.75 * a - 0.25 * b).abs() < 1e-15, "{got}");
    }

    #[test]
    fn invalid_field_is_refused() {
        let psf = || PsfModel::gaussian(0.8);
        let made = |nodes: [usize; 2], count: usize| PsfField::new(nodes, [64; 2], vec![psf(); count]);
        let nodes = "nodes, wanted 2 to 9 along each side (one PSF for all places needs no field)";
        assert_eq!(made([1, 3], 3), Err(Refused(format!("PSF field: 1 x 3 {nodes}"))));
        assert_eq!(made([2, 10], 20), Err(Refused(format!("PSF field: 2 x 10 {nodes}"))));
        let count = "PSF field: 5 PSFs for 2 x 2 nodes, wanted one for each";
        assert_eq!(made([2, 2], 5), Err(Refused(count.to_owned())));
        let mut nested = vec![psf(); 4];
        nested[2] = PsfModel::field(made([2, 2], 4).unwrap());
        let is_field = "PSF field: node 2 is a field itself, wanted a PSF for one place";
        assert_eq!(PsfField::new([2, 2], [64; 2], nested), Err(Refused(is_field.to_owned())));
    }
}
