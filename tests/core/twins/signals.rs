//! Specifications and samples that extraction finds hard, and results as bits.

use granular_id::dsp::Outside;
use granular_id::features::Initial;
use granular_id::FeatureSpec;
use proptest::prelude::*;

/// Values that a filter of order 1 and a histogram find hard: exact edges, zeros, far outside, subnormal.
pub fn value() -> impl Strategy<Value = f64> {
    prop_oneof![
        4 => -2.0..2.0_f64,
        1 => (-50..50_i32).prop_map(|n| f64::from(n) * 0.03),
        1 => Just(0.0),
        1 => Just(-0.0),
        1 => -1e6..1e6_f64,
        1 => Just(5e-324),
    ]
}

prop_compose! {
    pub fn spec()(
        order in 1..=11_usize,
        cutoff_hz in 1.0..249.0_f64,
        n_bins in 1..=130_usize,
        low in -3.0..0.5_f64,
        width in 0.01..3.0_f64,
        clip in any::<bool>(),
        steady in any::<bool>(),
        (raw, hfmh) in prop_oneof![Just((true, true)), Just((true, false)), Just((false, true))],
    ) -> FeatureSpec {
        FeatureSpec::default()
            .with_order(order)
            .with_cutoff_hz(cutoff_hz)
            .with_n_bins(n_bins)
            .with_bin_ranges(vec![(low, low + width)])
            .with_outside(if clip { Outside::Clip } else { Outside::Drop })
            .with_initial(if steady { Initial::Steady } else { Initial::Zero })
            .with_raw(raw)
            .with_hfmh(hfmh)
    }
}

pub fn bits(values: &[f64]) -> Vec<u64> {
    values.iter().map(|value| value.to_bits()).collect()
}

/// Numbers in [-1/2, 1/2), the same in every run.
pub fn uniform(mut seed: u64) -> impl FnMut() -> f64 {
    move || {
        seed ^= seed << 13;
        seed ^= seed >> 7;
        seed ^= seed << 17;
        (seed >> 11) as f64 / (1_u64 << 53) as f64 - 0.5
    }
}

/// Noise in [-1.5, 1.5), the same in every run.
pub fn noise(seed: u64, n: usize) -> Vec<f64> {
    let mut noise = uniform(seed);
    (0..n).map(|_| 3.0 * noise()).collect()
}
