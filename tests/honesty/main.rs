//! How soon headings come, how good they are, and whether they admit it when they are not: replays simulated and
//! recorded logs and prints one table.
//!
//! `cargo test --release --test honesty -- [OPTION]…` runs 20 seeds of each simulated family; `--help` lists the options.
//!
//! The status is 1 if a limit is missed.

mod bad_turns;
mod changes;
mod chips;
mod daemon;
mod drive;
mod families;
mod faults;
mod handled;
mod logs;
mod motion;
mod random;
mod rest;
mod score;
mod table;
mod vehicles;
mod waves;
mod wheels;
mod world;

use std::fs::File;
use std::io::BufWriter;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Instant;

use clap::Parser;
use families::Family;
use headingd::recording::{Header, Writer};
use random::Rng;
use score::Score;
use table::Row;

/// Seeds of each family without `--full`.
const FEW: usize = 20;

/// Replays simulated and recorded logs and prints one table.
#[derive(Parser)]
#[command(name = "honesty")]
struct Args {
    /// Runs as many seeds as the figures ask for
    #[arg(long)]
    full: bool,
    /// Runs the first N seeds
    #[arg(long, value_name = "N")]
    seeds: Option<usize>,
    /// Runs this seed alone
    #[arg(long, value_name = "N")]
    seed: Option<u64>,
    /// Runs one row, or all whose names contain the word; may be given again
    #[arg(long = "family", value_name = "WORD")]
    families: Vec<String>,
    /// Replays the recordings of real chips there, which are not part of the project
    #[arg(long, value_name = "DIR")]
    logs: Option<PathBuf>,
    /// Shows each seed's figures as well
    #[arg(long)]
    each: bool,
    /// Writes what one run shows, sample by sample
    #[arg(long, value_name = "FILE")]
    trace: Option<PathBuf>,
    /// Writes one run's readings as a log
    #[arg(long, value_name = "FILE")]
    write: Option<PathBuf>,
    /// Starts with the true calibration: what is left is what motion and place cost
    #[arg(long)]
    given_truth: bool,
    /// Tells the daemon what a model says of the place's field, its dip off by so much
    #[arg(long = "place", value_name = "DEG")]
    place_off_deg: Option<f64>,
}

fn main() -> ExitCode {
    let args = Args::parse();
    let one_run = args.trace.is_some() || args.write.is_some();
    if one_run && args.families.len() != 1 {
        eprintln!("honesty: --trace and --write keep one run: they need one --family");
        return ExitCode::from(2);
    }
    let names: Vec<&str> = (logs::ALL.iter().map(|log| log.name))
        .chain(families::ALL.iter().map(|family| family.name))
        .collect();
    // A whole name picks its row alone, a part of one all that contain it.
    let picks = |word: &str, name: &str| match names.contains(&word) {
        true => name == word,
        false => name.contains(word),
    };
    let wanted =
        |name: &str| args.families.is_empty() || args.families.iter().any(|word| picks(word, name));
    let is_unknown = |word: &&String| !names.iter().any(|name| picks(word, name));
    if let Some(word) = args.families.iter().find(is_unknown) {
        eprintln!(
            "honesty: no row is named like {word}; there are {}",
            names.join(", ")
        );
        return ExitCode::from(2);
    }
    println!("{}", table::head());
    let mut failed = 0;
    let mut print = |row: &Row| {
        println!("{}", row.line());
        failed += usize::from(row.failed);
    };
    let new_score = || {
        let mut score = Score::new(args.trace.as_deref().map(create), args.given_truth);
        score.place_off_deg = args.place_off_deg;
        score.readings = args.write.as_ref().map(|_| Vec::new());
        score
    };
    if args.seed.is_none() {
        for row in logs::rows(args.logs.as_deref(), &wanted, &new_score) {
            print(&row);
        }
    }
    let seed = args.seed.or(one_run.then_some(0));
    for family in families::ALL.iter().filter(|family| wanted(family.name)) {
        let most = if args.full { usize::MAX } else { FEW };
        let count = args.seeds.unwrap_or(family.seeds.min(most));
        let seeds: Vec<u64> = match seed {
            Some(seed) => vec![seed],
            None => (0..count as u64).collect(),
        };
        let begun = Instant::now();
        let scores = run(family, &seeds, &new_score);
        eprintln!("{}: {:.1} s", family.name, begun.elapsed().as_secs_f64());
        if args.each {
            score::each(&seeds, &scores);
        }
        if let Some(path) = &args.write {
            write_log(path, family.name, &scores[0]);
        }
        print(&Row::new(family.name, &scores, &family.limits));
    }
    if failed > 0 {
        eprintln!("honesty: {failed} rows miss a limit");
        return ExitCode::FAILURE;
    }
    ExitCode::SUCCESS
}

/// Runs a family's seeds on every core; the scores are in the order of the seeds.
fn run(family: &Family, seeds: &[u64], new_score: &(dyn Fn() -> Score + Sync)) -> Vec<Score> {
    let next = AtomicUsize::new(0);
    let done = Mutex::new(Vec::new());
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    std::thread::scope(|scope| {
        for _ in 0..cores.min(seeds.len()) {
            scope.spawn(|| {
                loop {
                    let index = next.fetch_add(1, Ordering::Relaxed);
                    let Some(seed) = seeds.get(index) else { return };
                    let mut rng = Rng::new(family.name, *seed);
                    let mut score = new_score();
                    (family.run)(&mut rng, &mut score);
                    done.lock().expect("no run panicked").push((index, score));
                }
            });
        }
    });
    let mut done = done.into_inner().expect("no run panicked");
    done.sort_by_key(|(index, _)| *index);
    done.into_iter().map(|(_, score)| score).collect()
}

fn create(path: &Path) -> BufWriter<File> {
    match File::create(path) {
        Ok(file) => BufWriter::new(file),
        Err(error) => panic!("cannot create {}: {error}", path.display()),
    }
}

/// Writes the readings of a run as a log.
fn write_log(path: &Path, family: &str, score: &Score) {
    let header = Header {
        sensor: Some(family.to_owned()),
        ..Header::default()
    };
    let mut writer = Writer::new(create(path), &header).expect("the log");
    for entry in score.readings.iter().flatten() {
        writer.write(entry).expect("the log");
    }
    writer.flush().expect("the log");
}
