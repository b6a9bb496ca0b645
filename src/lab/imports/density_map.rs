//! Catalogs and layers -> stars per square degree over the whole sky -> a picture.
//!
//! Stars are counted in HEALPix cells, so fine that a mean cell has some ten of them and no finer than order
//! `FINEST_ORDER`. The picture is a Mollweide projection (equal areas stay equal; Snyder, Map Projections, USGS Paper
//! 1395, p. 249), longitude rising to the left as one sees the sky, colours by the logarithm of the density. Tests:
//! `tests`.

use base::source::{direction_from_ra_dec, ra_dec_rad};
use base::{refused::Refused, units::DEG};
use core::f64::consts::{FRAC_PI_2, PI};
use glam::DVec3;
use stars::layer::Layer;
use stars::{catalog::Catalog, galactic::direction_of_galactic};

/// Finest cells: 0.9 deg, those of the coarsest layer.
const FINEST_ORDER: u8 = 6;
/// Coarsest cells: 7 deg.
const COARSEST_ORDER: u8 = 3;
/// Stars that a mean cell should have.
const STARS_PER_CELL: u64 = 10;
/// Square degrees of the whole sphere.
const SPHERE_DEG2: f64 = 4.0 * PI / (DEG * DEG);

/// Numbers of stars in the cells of the sky.
#[derive(Debug, Clone, PartialEq)]
pub struct DensityMap {
    /// The HEALPix order of its cells.
    pub order: u8,
    /// Stars of each cell, nested.
    counts: Vec<u64>,
}

impl Default for DensityMap {
    /// Returns a map without stars.
    fn default() -> Self {
        Self { order: FINEST_ORDER, counts: vec![0; 12 << (2 * FINEST_ORDER)] }
    }
}

impl DensityMap {
    /// Adds the stars of a catalog not fainter than `limiting_mag`.
    pub fn add_catalog(&mut self, catalog: &Catalog, limiting_mag: f32) {
        for star in catalog.sources().iter().filter(|star| star.mag_g <= limiting_mag) {
            let cell = self.cell_of(star.direction_icrf);
            self.counts[cell] += 1;
        }
    }

    /// Adds the stars of a layer not fainter than `limiting_mag`: by its table alone where all are, and by reading it
    /// where only some are.
    ///
    /// # Errors
    /// When a tile cannot be read or is damaged.
    pub fn add_layer(&mut self, layer: &Layer, limiting_mag: f32) -> Result<(), Refused> {
        let [from, below] = layer.index().magnitudes;
        if from > limiting_mag {
            return Ok(());
        }
        let (mut bytes, mut stars) = (Vec::new(), Vec::new());
        let finer = 2 * (layer.index().order - self.order);
        for (tile, count) in (0_u64..).zip(layer.index().stars_of_tiles()).filter(|(_, count)| *count > 0) {
            let counted = if limiting_mag >= below {
                count
            } else {
                stars.clear();
                layer.read_tile(tile, limiting_mag, 0, &mut bytes, &mut stars)?;
                stars.len() as u64
            };
            self.counts[usize::try_from(tile >> finer).unwrap_or(usize::MAX)] += counted;
        }
        Ok(())
    }

    /// Returns stars in it.
    pub fn stars(&self) -> u64 {
        self.counts.iter().sum()
    }

    /// Makes cells so coarse that the mean cell has enough stars to differ from its neighbours by more than noise.
    #[must_use]
    pub fn coarsened(mut self) -> Self {
        while self.order > COARSEST_ORDER && self.stars() < STARS_PER_CELL * self.counts.len() as u64 {
            self.counts = self.counts.as_chunks::<4>().0.iter().map(|four| four.iter().sum()).collect();
            self.order -= 1;
        }
        self
    }

    fn cell_of(&self, direction_icrf: DVec3) -> usize {
        let [ra, dec] = ra_dec_rad(direction_icrf);
        usize::try_from(stars::healpix::cell(self.order, ra, dec)).unwrap_or(usize::MAX)
    }

    fn per_deg2(&self, count: u64) -> f64 {
        count as f64 * self.counts.len() as f64 / SPHERE_DEG2
    }

    /// Returns stars per square degree about a direction (unit vector).
    pub fn density(&self, direction_icrf: DVec3) -> f64 {
        self.per_deg2(self.counts[self.cell_of(direction_icrf)])
    }

    /// Returns the right ascension and declination of its cells, rad, with the stars in each and per square degree.
    pub fn cells(&self) -> impl Iterator<Item = ([f64; 2], u64, f64)> {
        (0..).zip(&self.counts).map(|(cell, count)| {
            let (ra, dec) = stars::healpix::centre(self.order, cell);
            ([ra, dec], *count, self.per_deg2(*count))
        })
    }

    /// Returns the least and greatest density among cells with stars, stars per square degree; `None` without stars.
    pub fn range(&self) -> Option<[f64; 2]> {
        let with_stars = || self.counts.iter().copied().filter(|count| *count > 0);
        Some([self.per_deg2(with_stars().min()?), self.per_deg2(with_stars().max()?)])
    }
}

/// Returns the direction at a point of the picture, `None` beside the ellipse of the sky: `x` -1 (left) to 1, `y` -1
/// (bottom) to 1.
pub fn direction_at(x: f64, y: f64, is_galactic: bool) -> Option<DVec3> {
    if x * x + y * y > 1.0 {
        return None;
    }
    let theta = y.asin();
    let latitude = ((2.0 * theta + (2.0 * theta).sin()) / PI).clamp(-1.0, 1.0).asin();
    let longitude = if theta.abs() < FRAC_PI_2 { -PI * x / theta.cos() } else { 0.0 };
    Some(if is_galactic {
        direction_of_galactic(longitude, latitude)
    } else {
        direction_from_ra_dec(longitude, latitude)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synthetic::{Density, Population};

    fn galactic(longitude_deg: f64, latitude_deg: f64) -> DVec3 {
        direction_of_galactic(longitude_deg * DEG, latitude_deg * DEG)
    }

    #[test]
    fn every_star_is_counted_where_it_is() {
        let folder = tempfile::tempdir().unwrap();
        let population = Population::new(&[8.0, 9.0], Some(4e5), 1).unwrap();
        let reports = population.write(folder.path(), &mut |_| {}).unwrap();
        let layers: Vec<Layer> = reports.iter().map(|report| Layer::open(&report.path).unwrap()).collect();
        let map_to = |limit: f32| {
            let mut map = DensityMap::default();
            layers.iter().for_each(|layer| map.add_layer(layer, limit).unwrap());
            map
        };
        let all = map_to(99.0);
        assert_eq!(all.stars(), layers.iter().map(|layer| layer.index().stars()).sum::<u64>());
        // Stars of the fainter layer whose magnitude was rounded to 8.000 are not fainter than it.
        let rounded = map_to(8.0).stars() - layers[0].index().stars();
        assert!(rounded < 300 && map_to(-1.0).stars() == 0, "{rounded}");
        let (some, mut found) = (map_to(8.5), Vec::new());
        layers[1].cone(DVec3::Z, PI, 8.5, &mut found).unwrap();
        assert_eq!(some.stars(), layers[0].index().stars() + found.len() as u64, "a limit within a layer");
        let map = all.clone().coarsened();
        assert_eq!((map.stars(), map.order, all.order), (all.stars(), 5, 6));
        let scale = 4e5 / Population::new(&[8.0, 9.0], None, 1).unwrap().expected();
        for direction in [galactic(0.0, 0.0), galactic(0.0, 85.0), galactic(150.0, -30.0)] {
            let expected = Density::towards(direction).brighter_than(9.0) * scale;
            let cell_stars = expected * SPHERE_DEG2 / 12_288.0;
            let got = map.density(direction);
            assert!((got / expected - 1.0).abs() < 5.0 / cell_stars.sqrt() + 0.1, "{direction}: {got}, {expected}");
        }
        let cells: u64 = map.cells().map(|(_, stars, _)| stars).sum();
        assert_eq!(cells, map.stars());
        let [least, greatest] = map.range().unwrap();
        assert!(least < map.density(galactic(0.0, 85.0)) && greatest >= map.density(galactic(60.0, 0.0)));
        assert_eq!(DensityMap::default().range(), None);
    }

    #[test]
    fn packed_catalogs_are_counted_too() {
        let catalog = Catalog::built_in().unwrap();
        let mut map = DensityMap::default();
        map.add_catalog(&catalog, 99.0);
        assert_eq!(map.stars(), catalog.sources().len() as u64);
        let mut bright = DensityMap::default();
        bright.add_catalog(&catalog, 5.0);
        assert!(bright.stars() < 2500 && bright.stars() > 1200, "{}", bright.stars());
        assert_eq!(bright.coarsened().order, COARSEST_ORDER);
    }

    #[test]
    fn the_picture_has_the_sky_where_it_belongs() {
        let near = |x: f64, y: f64, wanted: DVec3| {
            let got = direction_at(x, y, true).unwrap();
            assert!(got.distance(wanted) < 1e-6, "{x} {y}: {got}");
        };
        near(0.0, 0.0, galactic(0.0, 0.0));
        near(0.0, 1.0, galactic(0.0, 90.0));
        near(0.5, 0.0, galactic(-90.0, 0.0));
        near(-0.5, 0.0, galactic(90.0, 0.0));
        // Snyder, p. 249: at latitude 40.1 the parallel is 0.6... of the height: theta by his eq. (31-4), solved
        // afresh.
        let latitude: f64 = 40.0 * DEG;
        let mut theta: f64 = latitude / 2.0;
        for _ in 0..50 {
            theta -= (2.0 * theta + (2.0 * theta).sin() - PI * latitude.sin()) / (2.0 + 2.0 * (2.0 * theta).cos());
        }
        near(0.0, theta.sin(), galactic(0.0, 40.0));
        near(-theta.cos() / 3.0, theta.sin(), galactic(60.0, 40.0));
        assert_eq!(direction_at(0.8, 0.8, true), None);
        assert!(direction_at(0.0, 0.0, false).unwrap().distance(DVec3::X) < 1e-12);
        // Equal areas: as many points of the picture are beyond 30 degrees of latitude as there is sky.
        let (mut all, mut high) = (0_u32, 0_u32);
        for i in 0..400 {
            for j in 0..400 {
                let at = |k: i32| (f64::from(k) + 0.5) / 200.0 - 1.0;
                if let Some(direction) = direction_at(at(i), at(j), false) {
                    all += 1;
                    high += u32::from(direction.z.abs() > 0.5);
                }
            }
        }
        assert!((f64::from(high) / f64::from(all) - 0.5).abs() < 0.003, "{high} of {all}");
    }
}
