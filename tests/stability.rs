//! Where usual methods fail, that ours do not, and how far ours can be pushed: one case a test, one row a case.
//!
//! `STABILITY.md` is the table of all rows; a test compares it with what is measured here.
//! `STOOP_WRITE_STABILITY=1 cargo test --release --test stability` writes it anew.
#![cfg(feature = "prepare")]
#![allow(clippy::unwrap_used, reason = "a test that cannot go on should stop")]

#[allow(dead_code, reason = "each test program uses its own part")]
mod analytic;
mod exact;
mod made_up;
mod scene;
mod towns;
mod vincenty;

mod stability {
    pub mod clocks;
    pub mod days;
    pub mod flights;
    pub mod frames;
    pub mod numbers;
    pub mod search;
    pub mod settled;
    pub mod shapes;
    pub mod sources;
    pub mod table;
}

use stability::table::{Row, assert_page};
use stability::{clocks, days, flights, frames, numbers, shapes, sources};
use std::sync::LazyLock;

/// Each case is measured once, for its own test and for the page.
macro_rules! cases {
    ($($case:ident: $measure:path),* $(,)?) => {
        mod measured {
            use super::*;
            $(
                #[allow(non_upper_case_globals, reason = "named like its test")]
                pub static $case: LazyLock<Row> = LazyLock::new($measure);
            )*
        }
        $(
            #[test]
            fn $case() {
                println!("{}", *measured::$case);
            }
        )*
        fn rows() -> Vec<&'static Row> {
            vec![$(&measured::$case),*]
        }
    };
}

cases! {
    positions_in_f32: numbers::positions_in_f32,
    depth_from_a_metre_to_ten_thousand_kilometres: numbers::depth,
    geodetic_coordinates_everywhere: numbers::geodetic_coordinates,
    geodesics_near_antipodes: numbers::geodesics,
    degenerate_footprints: shapes::footprints,
    poles_and_antimeridian: shapes::poles_and_antimeridian,
    a_trembling_eye_at_a_threshold: frames::thresholds,
    footprints_smaller_than_the_front: flights::small_footprints,
    dives_from_a_minute_to_a_second: flights::dives,
    teleports: flights::teleports,
    a_store_with_faults: flights::faults,
    sources_with_voids_and_spikes: sources::sources,
    clocks_that_jump: clocks::clocks,
    windows_from_one_pixel_to_16k: frames::windows,
    the_eye_under_coarse_ground: frames::coarse_ground,
    days_of_flight: days::days,
}

#[test]
fn the_page_says_what_is_measured() {
    assert_page(&rows());
}
