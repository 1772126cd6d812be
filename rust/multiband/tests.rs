//! Multi-band features: the same bits on every path, with any number of threads and in used memory; nothing allocated.

use allocation_counter::measure;
use proptest::prelude::*;

use super::envelope::{self, STRETCHES};
use super::extractor::{MAX_POOLED, MAX_VALUES};
use super::*;
use crate::features::MAX_SAMPLES;
use crate::{BatchShape, Error, SimdPath};

const ALL: MultiBandSpec = MultiBandSpec { rate_hz: 500.0, blocks: [true; 5] };

fn design(n_samples: usize, n_axes: usize) -> MultiBand {
    let scales = Scales::unit(n_bands(n_samples), n_axes).unwrap();
    MultiBand::new(ALL, n_samples, n_axes, &scales).unwrap()
}

/// Signals with a place for each.
pub(super) struct Signals {
    values: Vec<f32>,
    regions: Vec<Region>,
    pub(super) n_axes: usize,
}

impl Signals {
    /// Restless signals of some lengths.
    pub(super) fn new(lengths: &[usize], n_axes: usize) -> Self {
        let value = |band: usize, axis: usize, t: usize| {
            let phase = (band * 7 + axis * 3 + 1) as f64;
            narrow((0.37 * phase * t as f64).sin() + (1.3 * (t * t) as f64 + phase).cos() * 0.4)
        };
        let axis = |band, axis, n| (0..n).map(|t| value(band, axis, t)).collect();
        let band = |(band, n): (usize, &usize)| (0..n_axes).map(|a| axis(band, a, *n)).collect();
        Self::from(lengths.iter().enumerate().map(band).collect::<Vec<Vec<Vec<f32>>>>())
    }

    pub(super) fn view(&self) -> BandSignals<'_> {
        BandSignals { values: &self.values, regions: &self.regions, n_axes: self.n_axes }
    }

    /// What a statistic makes of them.
    pub(super) fn compute<S: Statistic>(&self, statistic: &S, path: SimdPath) -> Vec<f64> {
        let mut energies = vec![[0.0; STRETCHES]; self.regions.len() * self.n_axes];
        envelope::measure(self.view(), &mut energies);
        let split = Split { rows: &[], signals: self.view(), energies: &energies };
        let mut out = vec![0.0; statistic.n_features()];
        path.run(Compute { statistic, split, work: &mut statistic.work(), out: &mut out });
        out
    }

    pub(super) fn lengths(&self) -> Vec<usize> {
        self.regions.iter().map(|region| region.len).collect()
    }

    /// All axes of a band.
    pub(super) fn band(&self, band: usize) -> Vec<Vec<f32>> {
        (0..self.n_axes).map(|axis| self.view().axis(band, axis).to_vec()).collect()
    }
}

impl From<Vec<Vec<Vec<f32>>>> for Signals {
    /// By band, axis and sample.
    fn from(bands: Vec<Vec<Vec<f32>>>) -> Self {
        let mut start = 0;
        let region = |band: &Vec<Vec<f32>>| {
            let region = Region { start, stride: band[0].len(), len: band[0].len() };
            start += band.len() * region.stride;
            region
        };
        let (regions, n_axes) = (bands.iter().map(region).collect(), bands[0].len());
        Self { values: bands.concat().concat(), regions, n_axes }
    }
}

/// Numbers that look random, around an offset.
fn noise(len: usize, seed: u64) -> Vec<f64> {
    let mut state = seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1;
    let mut next = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as f64 / (1_u64 << 53) as f64
    };
    (0..len).map(|_| 4.0 * next() + 1.0).collect()
}

fn bits(values: &[f64]) -> Vec<u64> {
    values.iter().map(|value| value.to_bits()).collect()
}

#[test]
fn all_paths_threads_and_workspaces_give_the_same_bits() {
    for (n_samples, n_axes) in
        [(1, 1), (2, 3), (7, 6), (20, 13), (85, 5), (100, 1), (300, 6), (1600, 6), (1601, 4)]
    {
        let design = design(n_samples, n_axes);
        let shape = BatchShape { n_recordings: 9, n_samples, n_axes };
        let wrench = noise(9 * n_samples * n_axes, 3);
        let mut expected = vec![0.0; 9 * design.n_features()];
        design.extract_batch_on(SimdPath::Baseline, &wrench, shape, 1, &mut expected).unwrap();
        for path in SimdPath::available() {
            for threads in [1, 2] {
                let mut out = vec![f64::NAN; expected.len()];
                design.extract_batch_on(path, &wrench, shape, threads, &mut out).unwrap();
                assert!(bits(&out) == bits(&expected), "{path:?} {threads} {n_samples} {n_axes}");
            }
        }
        // A workspace that has seen other recordings, whole and begun.
        let mut work = design.workspace().unwrap();
        let mut out = vec![0.0; design.n_features()];
        for recording in [4, 0, 8] {
            let rows = &wrench[recording * n_samples * n_axes..][..n_samples * n_axes];
            design.extract_into(&rows[..n_axes * n_samples.div_ceil(3)], &mut work, &mut out).unwrap();
            design.extract_into(rows, &mut work, &mut out).unwrap();
            assert_eq!(bits(&out), bits(&expected[recording * out.len()..][..out.len()]));
        }
    }
}

#[test]
fn extraction_allocates_nothing() {
    for (n_samples, n_axes) in [(1, 1), (20, 13), (1600, 6), (1699, 3)] {
        let design = design(n_samples, n_axes);
        let rows = noise(n_samples * n_axes, 5);
        let mut work = design.workspace().unwrap();
        let mut out = vec![0.0; design.n_features()];
        let mut rms = vec![0.0; design.n_bands() * n_axes];
        design.extract_into(&rows, &mut work, &mut out).unwrap(); // finds out what the machine can do
        let counted = measure(|| {
            for n_seen in [n_samples, n_samples.div_ceil(2), 1, n_samples] {
                design.extract_into(&rows[..n_seen * n_axes], &mut work, &mut out).unwrap();
                design.rms_into(&rows[..n_seen * n_axes], &mut work, &mut rms).unwrap();
            }
        });
        assert_eq!((counted.count_total, counted.bytes_total), (0, 0), "{n_samples} {n_axes}");
    }
}

/// A copy works like its original, wherever its memory lies.
#[test]
fn a_clone_has_the_bits_of_its_original() {
    let (n_samples, n_axes) = (200, 2);
    let design = design(n_samples, n_axes);
    let rows = noise(n_samples * n_axes, 11);
    let (mut out, mut expected) = (vec![0.0; design.n_features()], vec![0.0; design.n_features()]);
    let mut work = design.workspace().unwrap();
    design.extract_into(&rows, &mut work, &mut expected).unwrap();
    let mut copies = Vec::new();
    for size in 1..20 {
        let mut copy = work.clone();
        design.extract_into(&rows, &mut copy, &mut out).unwrap();
        assert!(bits(&out) == bits(&expected));
        copies.push((copy, vec![0_u8; 16 * size]));
    }
}

/// Loud and long together: powers stay within float32.
#[test]
fn a_long_recording_at_the_limit_has_features() {
    let design = default_of(1 << 20);
    let rows: Vec<_> = (0..design.n_samples()).map(|t| if t % 8 < 4 { 1e12 } else { -1e12 }).collect();
    let mut out = vec![0.0; design.n_features()];
    design.extract_into(&rows, &mut design.workspace().unwrap(), &mut out).unwrap();
}

/// A recording that is refused leaves nothing behind in its workspace.
#[test]
fn a_refused_recording_leaves_nothing_behind() {
    let design = design(1000, 2);
    let (mut work, mut out) = (design.workspace().unwrap(), vec![0.0; design.n_features()]);
    let rows = noise(2000, 7);
    let mut expected = out.clone();
    design.extract_into(&rows, &mut work, &mut expected).unwrap();
    for bad in [1e13, f64::NAN, f64::INFINITY] {
        let mut wrong = rows.clone();
        wrong[300] = bad;
        assert!(design.extract_into(&wrong, &mut work, &mut out).is_err());
        design.extract_into(&rows, &mut work, &mut out).unwrap();
        assert!(bits(&out) == bits(&expected));
    }
}

#[test]
fn sizes_and_names_agree() {
    for (n_samples, n_axes) in [(1, 1), (3, 2), (50, 6), (105, 13), (1600, 6), (1600, 13), (100_000, 1)] {
        let design = design(n_samples, n_axes);
        let names = design.names().unwrap();
        let total: usize = design.block_sizes().iter().map(|(_, size)| size).sum();
        assert_eq!((names.len(), total), (design.n_features(), design.n_features()));
        assert!(names.iter().all(|name| !name.contains("__")));
        assert_eq!(design.bands().len(), design.n_bands());
    }
}

#[test]
fn errors_name_what_is_wrong() {
    let design = design(20, 2);
    let (mut work, mut out) = (design.workspace().unwrap(), vec![0.0; design.n_features()]);
    for len in [0, 1, 42] {
        let error = design.extract_into(&vec![0.0; len], &mut work, &mut out).unwrap_err();
        assert_eq!(error, Error::Length { what: "rows", expected: 40, got: len });
    }
    let error = design.extract_into(&[0.0; 40], &mut work, &mut [0.0]).unwrap_err();
    assert_eq!(error, Error::Length { what: "out", expected: design.n_features(), got: 1 });
    let mut rows = [0.0; 40];
    rows[7] = 1e13;
    let error = design.extract_into(&rows, &mut work, &mut out).unwrap_err();
    assert_eq!(error, Error::TooLarge { recording: 0, largest: 1e13, limit: TOO_LOUD });
    rows[11] = f64::NAN;
    let error = design.extract_into(&rows, &mut work, &mut out).unwrap_err();
    assert!(matches!(error, Error::NonFinite { recording: 0, sample: 5, axis: 1, .. }));
    // A workspace of another shape is replaced.
    let mut other = self::design(5, 1).workspace().unwrap();
    design.extract_into(&[1.0; 40], &mut other, &mut out).unwrap();
    let shape = BatchShape { n_recordings: 1, n_samples: 20, n_axes: 3 };
    let error = design.extract_batch(&[0.0; 60], shape, 1, &mut out).unwrap_err();
    assert!(matches!(error, Error::Argument { what: "recordings", .. }));
}

proptest! {
    #[test]
    fn finite_signals_have_finite_features_or_are_refused(
        n_axes in 1_usize..14,
        exponents in proptest::collection::vec(-320_i32..=308, 1..200),
        seed in any::<u64>(),
    ) {
        let n_samples = exponents.len().div_ceil(n_axes);
        let design = design(n_samples, n_axes);
        let mut rows = noise(n_samples * n_axes, seed);
        for (value, exponent) in rows.iter_mut().zip(&exponents) {
            *value = (*value - 3.0) / 5.0 * 10.0_f64.powi(*exponent);
        }
        let mut out = vec![0.0; design.n_features()];
        let largest = rows.iter().fold(0.0_f64, |largest, value| largest.max(value.abs()));
        match design.extract_into(&rows, &mut design.workspace().unwrap(), &mut out) {
            Ok(()) => prop_assert!(largest <= 1e12 && out.iter().all(|feature| feature.is_finite())),
            Err(error) => prop_assert_eq!(error, Error::TooLarge { recording: 0, largest, limit: TOO_LOUD }),
        }
    }
}

#[test]
fn recordings_too_large_for_any_memory_are_refused() {
    let unit = Scales::unit(1, 1).unwrap();
    for (n_samples, n_axes) in [
        (usize::MAX, 1),
        (MAX_SAMPLES, 1),
        (MAX_VALUES + 1, 1),
        (MAX_VALUES, 2),
        (1, MAX_VALUES + 1),
        (1, usize::MAX / 8 + 1),
        (MAX_SAMPLES, usize::MAX),
    ] {
        let error = MultiBand::new(MultiBandSpec::default(), n_samples, n_axes, &unit).unwrap_err();
        assert!(matches!(error, Error::Range { .. } | Error::Argument { .. }), "{error}");
    }
}

/// Every selection of blocks, in memory made for every other one and for another shape.
#[test]
fn memory_of_another_design_changes_nothing() {
    let (n_samples, n_axes) = (120, 2);
    let scales = Scales::unit(n_bands(n_samples), n_axes).unwrap();
    let rows: Vec<f64> = (0..n_samples * n_axes).map(|i| (0.37 * (i * i) as f64).sin()).collect();
    let designs: Vec<_> = (1..1 << Block::NAMED.len())
        .map(|blocks| {
            let spec = MultiBandSpec::of(500.0, |block| blocks >> block as u8 & 1 == 1);
            MultiBand::new(spec, n_samples, n_axes, &scales).unwrap()
        })
        .collect();
    let short =
        MultiBand::new(MultiBandSpec::default(), 7, n_axes, &Scales::unit(n_bands(7), n_axes).unwrap());
    let extract = |design: &MultiBand, mut work: Workspace| {
        let mut out = vec![f64::NAN; design.n_features()];
        design.extract_into(&rows, &mut work, &mut out).unwrap();
        out
    };
    let short = short.unwrap();
    for design in &designs {
        let own = extract(design, design.workspace().unwrap());
        assert!(own.iter().all(|feature| feature.is_finite()));
        for other in designs.iter().chain([&short]) {
            assert_eq!(extract(design, other.workspace().unwrap()), own);
        }
    }
}

fn default_of(n_samples: usize) -> MultiBand {
    let scales = Scales::unit(n_bands(n_samples), 1).unwrap();
    MultiBand::new(MultiBandSpec::default(), n_samples, 1, &scales).unwrap()
}

fn extract(design: &MultiBand, last: f64) -> Option<Vec<f64>> {
    let n_samples = design.n_samples();
    let mut wrench: Vec<f64> = (0..n_samples).map(|t| (0.3 * (t * t) as f64).sin()).collect();
    wrench[n_samples - 1] = last;
    let mut out = vec![0.0; design.n_features()];
    let shape = BatchShape { n_recordings: 1, n_samples, n_axes: 1 };
    design.extract_batch(&wrench, shape, 1, &mut out).ok().map(|()| out)
}

#[test]
fn the_next_batch_works_where_the_last_one_did() {
    let design = default_of(60);
    assert!(design.pool.take().is_none());
    let first = extract(&design, 0.5);
    assert_eq!(extract(&design, f64::NAN), None);
    assert_eq!(extract(&design, 0.5), first);
    assert!(design.clone().pool.take().is_none());
    assert!(design.pool.take().is_some_and(|work| (work.made_for.0, work.made_for.1) == (60, 1)));
}

#[test]
fn memory_of_long_recordings_is_given_back() {
    let design = default_of(MAX_POOLED + 1);
    assert!(extract(&design, 0.5).is_some());
    assert!(design.pool.take().is_none());
}
