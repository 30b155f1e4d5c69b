//! The paper's tests as one JSON object.

use serde::Serialize;

use super::published::{
    Column, ITERATIONS_SHARE, MPSOT_TIME_SHARE, RIST_TIME_SHARE, TEST1_SAMPLES,
};
use super::trial::Trial;

#[derive(Serialize)]
struct PaperReport<'a> {
    seed: u64,
    claims: Claims,
    tests: Vec<Test<'a>>,
}

/// What the paper's text says.
#[derive(Serialize)]
struct Claims {
    test1_samples: usize,
    test1_rist_samples: usize,
    mpsot_iterations_share: f64,
    rist_time_share: f64,
    mpsot_time_share: f64,
}

#[derive(Serialize)]
struct Test<'a> {
    rist_time_share: Option<f64>,
    mpsot_time_share: Option<f64>,
    #[serde(flatten)]
    ours: &'a Trial,
    paper: Paper,
}

/// The paper's four columns.
#[derive(Serialize)]
struct Paper {
    all: PublishedColumn,
    rist: PublishedColumn,
    pso: PublishedColumn,
    mpsot: PublishedColumn,
}

#[derive(Serialize)]
struct PublishedColumn {
    scale: Vec<f64>,
    bias_mgauss: Vec<f64>,
}

/// The object, on one line.
pub fn json(trials: &[Trial], seed: u64) -> serde_json::Result<String> {
    serde_json::to_string(&PaperReport {
        seed,
        claims: Claims {
            test1_samples: TEST1_SAMPLES[0],
            test1_rist_samples: TEST1_SAMPLES[1],
            mpsot_iterations_share: ITERATIONS_SHARE,
            rist_time_share: RIST_TIME_SHARE,
            mpsot_time_share: MPSOT_TIME_SHARE,
        },
        tests: trials.iter().map(test).collect(),
    })
}

fn test(trial: &Trial) -> Test<'_> {
    let numbers = |column: &Column| PublishedColumn {
        scale: column.scale[..trial.axes()].to_vec(),
        bias_mgauss: column.bias_mgauss[..trial.axes()].to_vec(),
    };
    Test {
        rist_time_share: trial.rist_time_share(),
        mpsot_time_share: trial.mpsot_time_share(),
        ours: trial,
        paper: Paper {
            all: numbers(&trial.published.all),
            rist: numbers(&trial.published.rist),
            pso: numbers(&trial.published.pso),
            mpsot: numbers(&trial.published.mpsot),
        },
    }
}
