//! What the paper published: Tables 1 to 4 of Ali et al., "Swarm Optimization-Based Magnetometer
//! Calibration for Personal Handheld Devices", Sensors 12 (2012), section 5.
//!
//! Tables 1 and 2 are its planar tests, Tables 3 and 4 the spatial ones. Its figures give no numbers in
//! the text but for two: 279 of 1240 samples in Test1 (Figure 7), and a third of the iterations in most
//! cases (Figure 8).

/// One column of the tables: three axes, of which a planar test has two.
#[derive(Clone, Copy, Debug)]
pub struct Column {
    /// Scale factors.
    pub scale: [f64; 3],
    /// Biases, milligauss.
    pub bias_mgauss: [f64; 3],
}

/// One of the paper's tests.
#[derive(Clone, Copy, Debug)]
pub struct Published {
    /// As the paper calls it.
    pub name: &'static str,
    /// Tables 1 and 3, "All": every sample.
    pub all: Column,
    /// Tables 1 and 3, "RIST".
    pub rist: Column,
    /// Tables 2 and 4, "PSO": basic, on RIST's samples.
    pub pso: Column,
    /// Tables 2 and 4, "MPSOT", on RIST's samples.
    pub mpsot: Column,
}

impl Published {
    /// Its four columns.
    pub fn columns(&self) -> [&Column; 4] {
        [&self.all, &self.rist, &self.pso, &self.mpsot]
    }
}

/// The reference of the planar tests, milligauss.
pub const HORIZONTAL_MGAUSS: f64 = 170.0;
/// The reference of the spatial tests, milligauss.
pub const TOTAL_MGAUSS: f64 = 560.0;
/// Test1 of the planar tests: samples in all, and in RIST's window.
pub const TEST1_SAMPLES: [usize; 2] = [1240, 279];
/// "The number of iterations is decreased to third in most cases".
pub const ITERATIONS_SHARE: f64 = 1.0 / 3.0;
/// "The use of the RIST reduces the processing time to 40 % of the time for the entire dataset".
pub const RIST_TIME_SHARE: f64 = 0.40;
/// "MPSOT improves the overall processing time to 35 % of the time consumed by the basic PSO".
pub const MPSOT_TIME_SHARE: f64 = 0.35;

/// Scale factors, then biases.
const fn planar(x_scale: f64, y_scale: f64, x_bias: f64, y_bias: f64) -> Column {
    Column {
        scale: [x_scale, y_scale, 1.0],
        bias_mgauss: [x_bias, y_bias, 0.0],
    }
}

/// Scale factors, then biases.
const fn spatial(scale: [f64; 3], bias_mgauss: [f64; 3]) -> Column {
    Column { scale, bias_mgauss }
}

/// Tables 1 and 2.
pub const PLANAR: [Published; 5] = [
    Published {
        name: "Test1",
        all: planar(0.873, 0.998, 87.279, 54.190),
        rist: planar(0.866, 0.973, 87.419, 50.008),
        pso: planar(0.858, 0.982, 85.615, 50.381),
        mpsot: planar(0.863, 1.027, 86.025, 46.695),
    },
    Published {
        name: "Test2",
        all: planar(0.601, 0.655, 33.490, 42.887),
        rist: planar(0.598, 0.649, 32.674, 42.193),
        pso: planar(0.597, 0.649, 32.659, 42.003),
        mpsot: planar(0.602, 0.629, 29.96, 43.227),
    },
    Published {
        name: "Test3",
        all: planar(0.925, 1.018, 66.016, 61.332),
        rist: planar(0.913, 1.050, 63.461, 58.556),
        pso: planar(0.913, 1.05, 63.563, 58.489),
        mpsot: planar(0.911, 1.049, 62.955, 58.503),
    },
    Published {
        name: "Test4",
        all: planar(2.498, 2.720, 36.912, 42.229),
        rist: planar(2.535, 2.773, 50.207, 51.725),
        pso: planar(2.534, 2.773, 50.356, 51.822),
        mpsot: planar(2.535, 2.773, 50.162, 51.59),
    },
    Published {
        name: "Test5",
        all: planar(0.791, 0.872, 19.483, 42.121),
        rist: planar(0.793, 0.869, 19.986, 43.142),
        pso: planar(0.787, 0.856, 18.75, 40.415),
        mpsot: planar(0.775, 0.859, 16.295, 47.76),
    },
];

/// Tables 3 and 4.
pub const SPATIAL: [Published; 6] = [
    Published {
        name: "Test1",
        all: spatial([1.0371, 1.1141, 0.9394], [38.1795, 30.8485, 135.8694]),
        rist: spatial([1.0325, 1.0985, 0.9317], [40.0139, 38.8051, 128.0139]),
        pso: spatial([1.0267, 1.1643, 0.9385], [40.0418, 8.1353, 133.0826]),
        mpsot: spatial([1.0228, 1.1334, 0.9515], [35.2361, 23.3182, 150.0231]),
    },
    Published {
        name: "Test2",
        all: spatial([1.0479, 1.1003, 0.9364], [36.3021, 34.2721, 135.5421]),
        rist: spatial([1.0465, 1.1014, 0.9384], [35.7039, 33.6313, 134.6297]),
        pso: spatial([1.0485, 1.0994, 0.9385], [36.1018, 33.8402, 134.9986]),
        mpsot: spatial([1.0449, 1.0998, 0.9325], [25.7854, 42.4474, 130.0379]),
    },
    Published {
        name: "Test3",
        all: spatial([1.0153, 1.0895, 0.9318], [40.3624, 37.8209, 134.4415]),
        rist: spatial([1.0158, 1.0860, 0.9324], [38.9419, 36.4251, 134.2701]),
        pso: spatial([1.0079, 1.0807, 0.928], [33.6985, 32.9084, 135.5549]),
        mpsot: spatial([1.0082, 1.0903, 0.9371], [32.2681, 20.48, 139.0494]),
    },
    Published {
        name: "Test4",
        all: spatial([0.9136, 0.9761, 0.8453], [28.4165, 46.2673, 121.8317]),
        rist: spatial([0.9249, 0.9718, 0.8541], [16.2188, 53.2383, 114.8561]),
        pso: spatial([0.9249, 0.9717, 0.8539], [18.5793, 51.7038, 115.2107]),
        mpsot: spatial([0.9152, 0.9868, 0.8452], [8.9173, 49.8835, 128.7535]),
    },
    Published {
        name: "Test5",
        all: spatial([0.9286, 0.9817, 0.8368], [34.5628, 58.8522, 129.9453]),
        rist: spatial([0.9248, 0.9859, 0.8460], [34.1847, 58.1043, 126.9294]),
        pso: spatial([0.9235, 0.9812, 0.8504], [32.2353, 59.1892, 127.8947]),
        mpsot: spatial([0.9008, 0.9916, 0.8608], [33.1784, 49.9255, 126.5982]),
    },
    Published {
        name: "Test6",
        all: spatial([0.9454, 1.0169, 0.8733], [46.1353, 33.8024, 126.3606]),
        rist: spatial([0.9311, 1.0167, 0.8674], [40.1545, 37.6382, 128.5436]),
        pso: spatial([0.9227, 1.0191, 0.8703], [38.1294, 31.4223, 130.0527]),
        mpsot: spatial([0.9276, 1.0281, 0.8644], [36.6339, 28.0506, 119.8037]),
    },
];
