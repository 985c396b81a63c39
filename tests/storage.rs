//! The storage models: exact times in small cases, and laws over random requests, cancellations and faults.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on should stop")]

use proptest::prelude::*;
use std::collections::BTreeMap;
use stoop::storage::{
    Arrival, BLOCK_BYTES, DEAD_TIMEOUT_SECS, Disk, Faults, PartOutcome, REQUEST_BYTES_MAX, Request, StorageModel,
};

/// 0.1 s, 1 MB/s.
fn slow(parallel: usize) -> StorageModel {
    format!("100,1,{parallel}").parse().unwrap()
}

fn request(id: u64, offset: u64, parts: &[u64]) -> Request {
    Request { id, file: 7, offset, parts: parts.to_vec() }
}

fn faults(text: &str) -> Faults {
    text.parse().unwrap()
}

/// Id, part and outcome where they are as expected, and times to a nanosecond.
fn assert_arrivals(found: &[Arrival], expected: &[(u64, usize, f64, PartOutcome)]) {
    let same = |(arrival, &(id, part, at_s, outcome)): (&Arrival, &(u64, usize, f64, PartOutcome))| {
        (arrival.id, arrival.part, arrival.outcome) == (id, part, outcome) && (arrival.at_s - at_s).abs() < 1e-9
    };
    assert!(found.len() == expected.len() && found.iter().zip(expected).all(same), "{found:#?}\nbut {expected:?}");
}

use PartOutcome::{Corrupt, Failed, Ok as Good};

#[test]
fn models_are_read_and_told() {
    for model in StorageModel::ALL {
        assert_eq!(model.to_string().parse(), Ok(model));
    }
    let hdd = StorageModel::HDD;
    assert_eq!((hdd.latency_secs, hdd.bytes_per_sec, hdd.parallel, hdd.seek_only), (0.01, 1.2e8, 1, true));
    let mobile = StorageModel::MOBILE;
    assert_eq!((mobile.latency_secs, mobile.bytes_per_sec, mobile.parallel), (0.15, 1e6, 4));
    for text in ["0.3,0.7,1", "20,50,4", "0,1000000,256"] {
        let model: StorageModel = text.parse().unwrap();
        assert_eq!((model.to_string().as_str(), model.seek_only), (text, false));
    }
    for bad in
        ["", "floppy", "HDD", "1,2", "1,2,3,4", "-1,2,3", "1,0,3", "1,2,0", "1,2,257", "nan,1,1", "1,inf,1", "a,b,c"]
    {
        let said = bad.parse::<StorageModel>().unwrap_err().to_string();
        assert!(said.contains(&format!("{bad:?}")) && said.contains("LATENCY_MS,MB_PER_S,PARALLEL"), "{said}");
        assert!(!said.contains('\n'), "{said}");
    }
}

#[test]
fn faults_are_read_and_nonsense_is_explained() {
    let all = faults("errors=0.01, corrupt=0.001,spike_ms=2000,spikes=0.02,die_s=12,revive_s=15,halve_s=10");
    assert_eq!((all.errors, all.corrupt, all.spike_secs, all.spikes), (0.01, 0.001, 2.0, 0.02));
    assert_eq!((all.die_s, all.revive_s, all.halve_s), (Some(12.0), Some(15.0), Some(10.0)));
    assert_eq!([11.9, 12.0, 14.9, 15.0].map(|at_s| all.is_dead(at_s)), [false, true, true, false]);
    assert_eq!((faults(""), faults("spike_ms=5").spikes), (Faults::NONE, 0.01));
    for (bad, part) in [
        ("luck=1", "no fault \"luck\""),
        ("errors", "no value of the fault errors"),
        ("errors=2", "from 0 to 1"),
        ("corrupt=nan", "from 0 to 1"),
        ("spike_ms=-1,spikes=1", "from 0 to 600000"),
        ("errors=0.1,errors=0.2", "errors is given twice"),
        ("spikes=0.1", "write spike_ms"),
        ("revive_s=3", "earlier die_s"),
        ("die_s=4,revive_s=4", "earlier die_s"),
    ] {
        let said = bad.parse::<Faults>().unwrap_err().to_string();
        assert!(said.contains(part) && !said.contains('\n'), "{bad}: {said}");
    }
}

#[test]
fn parts_arrive_with_their_last_byte_and_gaps_take_time() {
    let mut disk = Disk::new(StorageModel::WAN, Faults::NONE, 0);
    // The second part is bytes 400,000 to 500,000: what lies before it comes over the line all the same.
    assert!(disk.start(request(1, 0, &[100_000, 500_000]), 1.0));
    assert_eq!(disk.next_event_s(), Some(1.06));
    assert_eq!(disk.advance(1.079), []);
    assert_eq!(disk.counters().bytes, 95_000);
    assert_arrivals(&disk.advance(2.0), &[(1, 0, 1.08, Good), (1, 1, 1.16, Good)]);
    let counters = disk.counters();
    assert_eq!((counters.bytes, counters.seeks, counters.requests), (500_000, 1, 1));
    assert!((counters.busy_secs - 0.16).abs() < 1e-12);
    assert_eq!((disk.in_flight(), disk.next_event_s()), (0, None));
}

#[test]
fn transfers_share_the_bandwidth_and_latencies_do_not() {
    let mut disk = Disk::new(slow(2), Faults::NONE, 0);
    disk.start(request(1, 0, &[100_000]), 0.0);
    disk.start(request(2, 900_000, &[100_000]), 0.05);
    // The third one waits for a place: its latency begins when the first request ends.
    disk.start(request(3, 500_000, &[10_000]), 0.06);
    // 1 alone from 0.10 to 0.15: 50 kB; both to 0.25: 50 kB each; 2 alone to 0.30; 3 from 0.35.
    let expected = [(1, 0, 0.25, Good), (2, 0, 0.30, Good), (3, 0, 0.36, Good)];
    assert_arrivals(&disk.advance(1.0), &expected);
    assert_eq!(disk.counters().bytes, 210_000);
    assert!((disk.counters().busy_secs - 0.36).abs() < 1e-12);
}

#[test]
fn a_cancelled_transfer_makes_place_at_the_end_of_its_block() {
    let mut disk = Disk::new(slow(1), Faults::NONE, 0);
    disk.start(request(1, 0, &[50_000, 1 << 20]), 0.0);
    disk.start(request(2, 5 << 20, &[10_000]), 0.15);
    // 100,000 bytes are there: the second block ends at 131,072.
    assert!(disk.cancel(1, 0.2));
    assert!(!disk.cancel(1, 0.2), "it is gone");
    assert_eq!(disk.in_flight(), 1);
    assert_arrivals(&disk.advance(1.0), &[(1, 0, 0.15, Good), (2, 0, 0.1 + 0.131072 + 0.1 + 0.01, Good)]);
    assert_eq!(disk.counters().bytes, 2 * BLOCK_BYTES + 10_000);
}

#[test]
fn what_has_not_begun_costs_nothing() {
    let mut disk = Disk::new(slow(1), Faults::NONE, 0);
    disk.start(request(1, 0, &[10_000]), 0.0);
    disk.start(request(2, 1 << 20, &[1_000_000]), 0.0);
    disk.start(request(3, 2 << 20, &[20_000]), 0.0);
    assert!(disk.cancel(2, 0.05));
    assert_arrivals(&disk.advance(0.2), &[(1, 0, 0.11, Good)]);
    // The third waits for its first byte: it goes at once, without a byte.
    assert!(disk.cancel(3, 0.2));
    assert_eq!((disk.in_flight(), disk.next_event_s()), (0, None));
    disk.start(request(4, 3 << 20, &[30_000]), 0.2);
    assert_arrivals(&disk.advance(1.0), &[(4, 0, 0.33, Good)]);
    let counters = disk.counters();
    assert_eq!((counters.bytes, counters.requests), (40_000, 3));
    assert!((counters.busy_secs - 0.33).abs() < 1e-12);
}

#[test]
fn a_disk_seeks_only_where_a_range_does_not_go_on() {
    let mut disk = Disk::new(StorageModel::HDD, Faults::NONE, 0);
    disk.start(request(1, 0, &[600_000]), 0.0);
    disk.start(request(2, 600_000, &[600_000]), 0.0);
    // Another file, the place where that one ends, and back.
    disk.start(Request { file: 8, ..request(3, 1_200_000, &[600_000]) }, 0.0);
    disk.start(request(4, 1_200_000, &[600_000]), 0.0);
    let expected = [(1, 0, 0.015, Good), (2, 0, 0.020, Good), (3, 0, 0.035, Good), (4, 0, 0.050, Good)];
    assert_arrivals(&disk.advance(1.0), &expected);
    assert_eq!(disk.counters().seeks, 3);
    // Idle or not, the head stays; a cancelled transfer leaves it at its block's end: 0.4 ms are 48,000 bytes.
    disk.start(request(5, 1_800_000, &[600_000]), 2.0);
    assert!(disk.cancel(5, 2.0004));
    disk.start(request(6, 1_800_000 + BLOCK_BYTES, &[600_000]), 2.001);
    assert_arrivals(&disk.advance(3.0), &[(6, 0, 2.006, Good)]);
    // One that was cancelled while seeking leaves it nowhere.
    disk.start(request(7, 0, &[600_000]), 3.0);
    assert!(disk.cancel(7, 3.005));
    disk.start(request(8, 600_000, &[600_000]), 3.005);
    assert_arrivals(&disk.advance(4.0), &[(8, 0, 3.02, Good)]);
    assert_eq!(disk.counters().seeks, 5);
}

#[test]
fn elsewhere_each_request_pays() {
    let mut disk = Disk::new(slow(1), Faults::NONE, 0);
    disk.start(request(1, 0, &[50_000]), 0.0);
    disk.start(request(2, 50_000, &[50_000]), 0.0);
    assert_arrivals(&disk.advance(1.0), &[(1, 0, 0.15, Good), (2, 0, 0.30, Good)]);
    assert_eq!(disk.counters().seeks, 1, "it goes on where the first one ended");
}

#[test]
fn a_page_may_be_larger_than_a_request_alone() {
    let mut disk = Disk::new(slow(1), Faults::NONE, 0);
    assert!(disk.start(request(1, 0, &[3 * REQUEST_BYTES_MAX]), 0.0));
    assert_eq!(disk.advance(10.0).len(), 1);
    assert!(!disk.start(request(2, 0, &[]), 10.0), "nothing is asked for");
}

#[test]
fn a_dead_server_fails_after_a_timeout_and_revives() {
    let mut disk = Disk::new(slow(1), faults("die_s=0.15,revive_s=3"), 0);
    disk.start(request(1, 0, &[20_000, 200_000]), 0.0);
    disk.start(request(2, 1 << 20, &[10_000]), 0.0);
    disk.start(request(3, 2 << 20, &[10_000]), 0.0);
    let first = 0.15 + DEAD_TIMEOUT_SECS;
    let second = first + DEAD_TIMEOUT_SECS;
    let expected = [(1, 0, 0.12, Good), (1, 1, first, Failed), (2, 0, second, Failed), (3, 0, second + 0.11, Good)];
    assert_arrivals(&disk.advance(10.0), &expected);
    assert_eq!(disk.counters().bytes, 60_000, "50,000 before it died");
}

#[test]
fn the_bandwidth_halves_in_the_middle_of_a_transfer() {
    let mut disk = Disk::new(slow(2), faults("halve_s=0.2"), 0);
    disk.start(request(1, 0, &[150_000]), 0.0);
    assert_arrivals(&disk.advance(1.0), &[(1, 0, 0.3, Good)]);
    disk.start(request(2, 0, &[150_000]), 1.0);
    assert_arrivals(&disk.advance(2.0), &[(2, 0, 1.4, Good)]);
}

#[test]
fn spikes_delay_and_errors_fail() {
    let mut disk = Disk::new(slow(1), faults("spike_ms=500,spikes=1,errors=1"), 0);
    disk.start(request(1, 0, &[10_000, 50_000]), 0.0);
    assert_arrivals(&disk.advance(1.0), &[(1, 0, 0.61, Failed), (1, 1, 0.65, Failed)]);
}

const SAMPLE: u64 = 20_000;

/// Outcomes of parts 0 to [`SAMPLE`] by their place, asked for in an order, `parts` at a time.
fn outcomes(disk: &mut Disk, order: impl Iterator<Item = u64>, parts: u64) -> BTreeMap<u64, PartOutcome> {
    let mut found = BTreeMap::new();
    for first in order {
        let now_s = disk.next_event_s().unwrap_or(0.0);
        let ends: Vec<u64> = (1..=parts).map(|part| part * 1000).collect();
        assert!(disk.start(request(first, first * parts * 1000, &ends), now_s));
        let arrivals = disk.advance(f64::INFINITY);
        found.extend(arrivals.iter().map(|arrival| (first * parts + arrival.part as u64, arrival.outcome)));
    }
    found
}

fn count(outcomes: &BTreeMap<u64, PartOutcome>, outcome: PartOutcome) -> f64 {
    outcomes.values().filter(|&&found| found == outcome).count() as f64
}

#[test]
fn fates_have_their_rates_and_follow_from_seed_place_and_attempt_alone() {
    let faults = faults("errors=0.05,corrupt=0.02");
    let mut disk = Disk::new(StorageModel::SSD, faults, 3);
    let first = outcomes(&mut disk, 0..SAMPLE, 1);
    let (failed, corrupt) = (count(&first, Failed), count(&first, Corrupt));
    // Five standard deviations.
    assert!((failed - 0.05 * SAMPLE as f64).abs() < 5.0 * 31.0, "{failed}");
    assert!((corrupt - 0.02 * 0.95 * SAMPLE as f64).abs() < 5.0 * 20.0, "{corrupt}");

    let backwards = outcomes(&mut Disk::new(StorageModel::WAN, faults, 3), (0..SAMPLE / 4).rev(), 4);
    assert_eq!(backwards, first, "order, ranges and model do not matter");
    let other = outcomes(&mut Disk::new(StorageModel::SSD, faults, 4), 0..SAMPLE, 1);
    assert_ne!(other, first, "the seed does");

    let second = outcomes(&mut disk, 0..SAMPLE, 1);
    for (part, outcome) in &first {
        assert!(*outcome != Corrupt || second[part] != Good, "what is stored wrong does not heal: {part}");
    }
    let both = first.iter().filter(|(part, outcome)| **outcome == Failed && second[part] == Failed).count();
    assert!(both > 0 && both < 150, "errors are of one attempt: {both} of {failed} failed twice");
    assert!((count(&second, Failed) - 0.05 * SAMPLE as f64).abs() < 5.0 * 31.0);
}

#[test]
fn spikes_have_their_rate() {
    let mut disk = Disk::new(slow(1), faults("spike_ms=1000,spikes=0.05"), 1);
    let late = (0..SAMPLE).filter(|&n| {
        let now_s = n as f64 * 10.0;
        disk.start(request(n, n * 1000, &[1000]), now_s);
        disk.advance(now_s + 9.0)[0].at_s > now_s + 1.0
    });
    let late = late.count() as f64;
    assert!((late - 0.05 * SAMPLE as f64).abs() < 5.0 * 31.0, "{late}");
}

#[derive(Clone, Debug)]
enum Step {
    /// Seconds to wait before it, offset, lengths of parts and of the gaps before them.
    Start {
        wait_secs: f64,
        offset: u64,
        pieces: Vec<(u64, u64)>,
    },
    /// Of a started request, as a share of their number.
    Cancel {
        wait_secs: f64,
        which: f64,
    },
    Look {
        wait_secs: f64,
    },
}

fn some_steps() -> impl Strategy<Value = Vec<Step>> {
    let wait = || prop_oneof![Just(0.0), 0.0..0.02, 0.0..0.5];
    let pieces = prop::collection::vec((0u64..20_000, 1u64..100_000), 1..8);
    let start = (wait(), prop_oneof![Just(0), 0u64..1 << 30], pieces)
        .prop_map(|(wait_secs, offset, pieces)| Step::Start { wait_secs, offset, pieces });
    let cancel = (wait(), 0.0..1.0).prop_map(|(wait_secs, which)| Step::Cancel { wait_secs, which });
    let look = wait().prop_map(|wait_secs| Step::Look { wait_secs });
    prop::collection::vec(prop_oneof![4 => start, 2 => cancel, 2 => look], 1..120)
}

fn some_model() -> impl Strategy<Value = StorageModel> {
    let custom = (0.0..100.0, 0.1..200.0, 1usize..10).prop_map(|(latency_ms, mb_per_sec, parallel)| {
        format!("{latency_ms},{mb_per_sec},{parallel}").parse().unwrap()
    });
    prop_oneof![prop::sample::select(StorageModel::ALL.to_vec()), custom]
}

fn some_faults() -> impl Strategy<Value = Faults> {
    let texts =
        ["", "errors=0.2,corrupt=0.1", "spike_ms=300,spikes=0.2", "die_s=1,revive_s=2", "die_s=0.5", "halve_s=1"];
    prop::sample::select(texts.to_vec()).prop_map(faults)
}

/// What a run showed.
#[derive(Debug, Default, PartialEq)]
struct Run {
    arrivals: Vec<Arrival>,
    /// Parts by request.
    started: BTreeMap<u64, usize>,
    cancelled_at_s: BTreeMap<u64, f64>,
    /// Time and bytes so far.
    bytes: Vec<(f64, u64)>,
    seeks: u64,
}

/// Plays steps; `looks` more often makes no difference to what happens.
fn play(mut disk: Disk, steps: &[Step], looks: u32) -> Run {
    let (mut run, mut now_s) = (Run::default(), 0.0);
    for (id, step) in (0..).zip(steps) {
        let (Step::Start { wait_secs, .. } | Step::Cancel { wait_secs, .. } | Step::Look { wait_secs }) = step;
        for look in 1..looks {
            run.arrivals.extend(disk.advance(now_s + wait_secs * f64::from(look) / f64::from(looks)));
        }
        now_s += wait_secs;
        match step {
            Step::Start { offset, pieces, .. } => {
                let ends = pieces.iter().scan(0, |end, (gap, len)| {
                    *end += gap + len;
                    Some(*end)
                });
                let parts: Vec<u64> = ends.collect();
                run.started.insert(id, parts.len());
                assert!(disk.start(Request { id, file: 0, offset: *offset, parts }, now_s));
            }
            Step::Cancel { which, .. } => {
                let id = run.started.keys().nth((which * run.started.len() as f64) as usize).copied();
                if let Some(id) = id.filter(|&id| disk.cancel(id, now_s)) {
                    run.cancelled_at_s.insert(id, now_s);
                }
            }
            Step::Look { .. } => run.arrivals.extend(disk.advance(now_s)),
        }
        run.bytes.push((now_s, disk.counters().bytes));
    }
    run.arrivals.extend(disk.advance(f64::INFINITY));
    assert_eq!((disk.in_flight(), disk.next_event_s()), (0, None));
    run.seeks = disk.counters().seeks;
    run
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]

    #[test]
    fn no_window_has_more_bytes_than_the_bandwidth_and_no_start_more_than_the_bound(
        model in some_model(), steps in some_steps(), faults in some_faults(),
    ) {
        let run = play(Disk::new(model, faults, 1), &steps, 1);
        let (bandwidth, latency_secs) = (model.bytes_per_sec, model.latency_secs);
        for (at, &(from_s, before)) in run.bytes.iter().enumerate() {
            for &(to_s, after) in &run.bytes[at..] {
                prop_assert!(after >= before);
                prop_assert!((after - before) as f64 <= bandwidth * (to_s - from_s) + 1.0);
            }
        }
        for &(t_s, bytes) in &run.bytes {
            let mut bound = bandwidth * (t_s - latency_secs).max(0.0);
            if !model.seek_only && latency_secs > 0.0 {
                let rounds = (t_s / latency_secs + 1e-9).floor();
                bound = bound.min(model.parallel as f64 * REQUEST_BYTES_MAX as f64 * rounds);
            }
            prop_assert!(bytes as f64 <= bound + 1.0, "{bytes} bytes at {t_s} s, at most {bound}");
        }
    }

    #[test]
    fn each_started_part_ends_once_in_order_or_is_cancelled(
        model in some_model(), steps in some_steps(), faults in some_faults(), seed: u64,
    ) {
        let run = play(Disk::new(model, faults, seed), &steps, 1);
        prop_assert!(run.arrivals.is_sorted_by(|a, b| a.at_s <= b.at_s));
        let mut arrived: BTreeMap<u64, usize> = BTreeMap::new();
        for arrival in &run.arrivals {
            let next = arrived.entry(arrival.id).or_default();
            prop_assert_eq!(arrival.part, *next, "parts come in their order, each once");
            *next += 1;
            let cancelled_s = run.cancelled_at_s.get(&arrival.id).copied().unwrap_or(f64::INFINITY);
            prop_assert!(arrival.at_s <= cancelled_s);
        }
        for (id, &parts) in &run.started {
            let came = arrived.get(id).copied().unwrap_or(0);
            prop_assert!(came <= parts && (came == parts) != run.cancelled_at_s.contains_key(id));
        }
    }

    #[test]
    fn the_same_requests_give_the_same_arrivals_however_often_one_looks(
        model in some_model(), steps in some_steps(), faults in some_faults(), seed: u64, looks in 2u32..5,
    ) {
        let first = play(Disk::new(model, faults, seed), &steps, 1);
        prop_assert_eq!(&first, &play(Disk::new(model, faults, seed), &steps, 1));
        prop_assert_eq!(&first, &play(Disk::new(model, faults, seed), &steps, looks));
    }
}
