//! The magnetic field of a place: the earth's, and dipoles that stand or move in it. North, east, down; milligauss.

use headingd::true_north::{EarthField, ValueWithSd};
use nalgebra::{Rotation3, Vector3};

use crate::random::Rng;

/// Something magnetic. In metres and A·m² its field in milligauss is `(3 (m·r̂) r̂ − m) / r³`:
/// µ0/4π is 1e-7 T·m/A, and a tesla is 1e7 milligauss.
#[derive(Clone, Copy)]
pub struct Dipole {
    pub position: Vector3<f64>,
    pub velocity: Vector3<f64>,
    pub moment: Vector3<f64>,
}

impl Dipole {
    pub fn field(&self, at: &Vector3<f64>) -> Vector3<f64> {
        let r = at - self.position;
        // Nothing comes nearer than 10 cm to a dipole's middle.
        let square = r.norm_squared().max(0.01);
        let cube = square * square.sqrt();
        r * (3.0 * self.moment.dot(&r) / (square * cube)) - self.moment / cube
    }
}

/// The field.
pub struct World {
    /// Of the earth: its azimuth is magnetic north, so it has no east.
    pub earth: Vector3<f64>,
    /// Added everywhere alike, for swell and creep.
    pub added: Vector3<f64>,
    pub dipoles: Vec<Dipole>,
    /// What the dipoles make of the place on average. It is the place's north, not an error of its compass.
    mean: Vector3<f64>,
}

impl World {
    /// The earth's field somewhere between 50 and 73 degrees of dip, 450 to 550 mG strong.
    pub fn draw(rng: &mut Rng) -> Self {
        let strength = rng.uniform(450.0, 550.0);
        let dip = rng.uniform(50.0, 73.0).to_radians();
        Self {
            earth: Vector3::new(strength * dip.cos(), 0.0, strength * dip.sin()),
            added: Vector3::zeros(),
            dipoles: Vec::new(),
            mean: Vector3::zeros(),
        }
    }

    pub fn strength(&self) -> f64 {
        self.earth.norm()
    }

    /// What a model of the earth's field says of this place, its dip off by so much: buildings make the field differ from it by
    /// 5 % on each axis. No other random numbers change by that.
    pub fn place(&self, off_deg: f64) -> EarthField {
        let mut rng = Rng::new("place", self.strength().to_bits());
        let east = Vector3::y_axis();
        let turned = Rotation3::from_axis_angle(&east, -off_deg.to_radians()) * self.earth;
        let told = turned + rng.vector(0.05 * self.strength());
        let known = |value: f64, sd: f64| ValueWithSd { value, sd };
        EarthField {
            declination_deg: known(0.0, 0.4),
            dip_deg: known(told.z.atan2(told.xy().norm()).to_degrees(), 0.2),
            strength_mgauss: known(told.norm(), 1.4),
            horizontal_mgauss: known(told.xy().norm(), 1.3),
            zone: None,
        }
    }

    /// Puts iron around the origin, 1.2 to 3 m away, so that the field differs by `share` of its strength (RMS)
    /// between places half a metre apart. Furnished rooms have 1 to 2 %.
    pub fn furnish(&mut self, rng: &mut Rng, share: f64) {
        for _ in 0..6 {
            self.dipoles.push(Dipole {
                position: rng.direction() * rng.uniform(1.2, 3.0),
                velocity: Vector3::zeros(),
                moment: rng.direction() * rng.uniform(0.3, 1.0),
            });
        }
        let places: Vec<_> = (0..40).map(|_| rng.direction() * 0.25).collect();
        self.scale(share, places.iter().map(|p| (*p, -*p)));
        self.settle(places.into_iter());
    }

    /// Puts iron under a floor of `half`×2 metres, so that the field differs by `share` (RMS) from metre to metre.
    pub fn reinforce(&mut self, rng: &mut Rng, share: f64, half: f64) {
        let count = (half * half * 3.0) as usize;
        for _ in 0..count {
            self.dipoles.push(Dipole {
                position: Vector3::new(
                    rng.uniform(-half, half),
                    rng.uniform(-half, half),
                    rng.uniform(0.5, 1.2),
                ),
                velocity: Vector3::zeros(),
                moment: rng.direction() * rng.uniform(0.2, 1.0),
            });
        }
        let reach = half - 1.0;
        let places: Vec<_> = (0..200)
            .map(|_| Vector3::new(rng.uniform(-reach, reach), rng.uniform(-reach, reach), 0.0))
            .collect();
        let pairs: Vec<_> = places
            .iter()
            .map(|p| {
                let angle = rng.uniform(0.0, std::f64::consts::TAU);
                (*p, p + Vector3::new(angle.cos(), angle.sin(), 0.0))
            })
            .collect();
        self.scale(share, pairs.into_iter());
        self.settle(places.into_iter());
    }

    /// Makes the dipoles as strong as the wanted unevenness asks for.
    fn scale(&mut self, share: f64, pairs: impl Iterator<Item = (Vector3<f64>, Vector3<f64>)>) {
        let (sum, count) = pairs.fold((0.0, 0.0), |(sum, count), (a, b)| {
            (
                sum + (self.of_dipoles(&a) - self.of_dipoles(&b)).norm_squared(),
                count + 1.0,
            )
        });
        let factor = share * self.strength() / f64::sqrt(sum / count);
        for dipole in &mut self.dipoles {
            dipole.moment *= factor;
        }
    }

    fn settle(&mut self, places: impl ExactSizeIterator<Item = Vector3<f64>>) {
        let count = places.len() as f64;
        self.mean = places.map(|p| self.of_dipoles(&p)).sum::<Vector3<f64>>() / count;
    }

    fn of_dipoles(&self, at: &Vector3<f64>) -> Vector3<f64> {
        self.dipoles.iter().map(|dipole| dipole.field(at)).sum()
    }

    pub fn field(&self, at: &Vector3<f64>) -> Vector3<f64> {
        self.earth + self.added - self.mean + self.of_dipoles(at)
    }

    /// Moves what moves, and forgets what is too far from `at` to matter.
    pub fn step(&mut self, dt_s: f64, at: &Vector3<f64>) {
        let mut gone = false;
        for dipole in &mut self.dipoles {
            if dipole.velocity != Vector3::zeros() {
                dipole.position += dipole.velocity * dt_s;
                gone |= (dipole.position - at).norm_squared() > 10_000.0;
            }
        }
        if gone {
            self.dipoles
                .retain(|d| (d.position - at).norm_squared() <= 10_000.0);
        }
    }
}
