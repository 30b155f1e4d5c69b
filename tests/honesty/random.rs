//! Seeded random numbers, and smooth random processes made from them.

use nalgebra::{Matrix3, Rotation3, Vector3};
use rand::{RngExt, SeedableRng};
use rand_distr::{Distribution, StandardNormal};
use rand_xoshiro::Xoshiro256PlusPlus;

/// The random numbers of one run.
pub struct Rng(Xoshiro256PlusPlus);

impl Rng {
    /// Its own numbers for each family and seed, so that a new family does not change the others.
    pub fn new(family: &str, seed: u64) -> Self {
        let name = family.bytes().fold(0xcbf2_9ce4_8422_2325, |hash: u64, b| {
            (hash ^ u64::from(b)).wrapping_mul(0x0100_0000_01b3)
        });
        Self(Xoshiro256PlusPlus::seed_from_u64(
            name ^ seed.wrapping_mul(0x9e37_79b9_7f4a_7c15),
        ))
    }

    /// Other numbers for what is new in a family, so that all else in its runs stays as it was.
    pub fn apart(&self) -> Self {
        let mut numbers = self.0.clone();
        numbers.jump();
        Self(numbers)
    }

    pub fn uniform(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.0.random::<f64>()
    }

    pub fn log_uniform(&mut self, low: f64, high: f64) -> f64 {
        self.uniform(low.ln(), high.ln()).exp()
    }

    pub fn normal(&mut self) -> f64 {
        StandardNormal.sample(&mut self.0)
    }

    pub fn chance(&mut self, probability: f64) -> bool {
        self.0.random::<f64>() < probability
    }

    pub fn sign(&mut self) -> f64 {
        if self.chance(0.5) { 1.0 } else { -1.0 }
    }

    /// Waiting time of something that happens once in `mean`, on average.
    pub fn wait(&mut self, mean: f64) -> f64 {
        -mean * (1.0 - self.0.random::<f64>()).ln()
    }

    /// Normal numbers with this standard deviation.
    pub fn vector(&mut self, sd: f64) -> Vector3<f64> {
        Vector3::new(self.normal(), self.normal(), self.normal()) * sd
    }

    /// A unit vector, every direction equally likely.
    pub fn direction(&mut self) -> Vector3<f64> {
        self.vector(1.0).normalize()
    }

    /// A rotation by up to this angle about any axis.
    pub fn rotation(&mut self, most_deg: f64) -> Matrix3<f64> {
        let angle = self.uniform(0.0, most_deg.to_radians());
        Rotation3::new(self.direction() * angle).into_inner()
    }

    /// A symmetric matrix whose eigenvalues lie within `most` of 1, one of them at an end of a drawn range.
    pub fn soft_iron(&mut self, most: f64) -> Matrix3<f64> {
        let size = self.uniform(0.0, most);
        let axes = Rotation3::new(self.direction() * self.uniform(0.0, 3.0)).into_inner();
        let stretch = Vector3::new(
            self.sign() * size,
            self.uniform(-size, size),
            self.uniform(-size, size),
        );
        Matrix3::identity() + axes * Matrix3::from_diagonal(&stretch) * axes.transpose()
    }
}

/// A stationary random process of unit variance: white noise through `N` equal low-passes. Its first `N` - 1
/// derivatives exist.
pub struct Smooth<const N: usize> {
    stages: [Vector3<f64>; N],
    tau_s: f64,
}

impl<const N: usize> Smooth<N> {
    /// One that has been running for long.
    pub fn new(tau_s: f64, rng: &mut Rng) -> Self {
        let mut process = Self {
            stages: [Vector3::zeros(); N],
            tau_s,
        };
        for _ in 0..60 * N {
            process.step(rng, tau_s / 10.0);
        }
        process
    }

    /// Its value `dt_s` later: three independent components.
    pub fn step(&mut self, rng: &mut Rng, dt_s: f64) -> Vector3<f64> {
        let keep = (-dt_s / self.tau_s).exp();
        let mut input = self.stages[0] * keep + rng.vector((1.0 - keep * keep).sqrt());
        self.stages[0] = input;
        for stage in &mut self.stages[1..] {
            *stage += (input - *stage) * (1.0 - keep);
            input = *stage;
        }
        // Variance that N low-passes leave of one: (2N-2 over N-1) / 4^(N-1).
        let left = (1..N).fold(1.0, |v, k| v * (2 * k - 1) as f64 / (2 * k) as f64);
        input / left.sqrt()
    }
}
