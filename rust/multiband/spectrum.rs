//! Power over frequency: the Hann periodogram of the mean-free signal, pooled into bins of nearly equal ratio.

use std::f64::consts::PI;
use std::ops::Range;

use super::fft::{ComplexValues, Fft, FftWork};
use super::logarithm::{each, Log};
use super::{Split, Statistic, LANES};
use crate::dsp::Real;
use crate::kernel::{Register, Simd, Vectors};

/// Pooled bins at most.
const BINS: usize = 40;

/// Frequencies per bin at least; the logarithm of fewer is mostly chance.
const MIN_WIDTH: usize = 3;

/// Samples from which on there are more bins than octaves. A coarser spectrum only repeats the envelope.
pub(super) const LEAST_SAMPLES: usize = 18;

/// Added to scaled powers before the logarithm.
const FLOOR: f64 = 1e-6;

/// Axes of which powers are added up at a time.
const AXES: usize = LANES;

/// The statistic for signals of some length.
#[derive(Clone, Debug)]
pub(super) struct Spectrum {
    n_axes: usize,
    n_samples: usize,
    /// First frequency of each bin, then one past the last, in steps of the transform.
    pub(super) edges: Vec<usize>,
    fft: Fft,
}

/// What one thread needs to compute it.
#[derive(Clone, Debug)]
pub(super) struct SpectrumWork {
    transform: FftWork,
    /// Powers of a few axes, axis by axis.
    powers: [Vec<f32>; AXES],
    /// The window of the length that came last, and the sum of its squares.
    window: Vec<f32>,
    weight: f64,
}

impl Spectrum {
    pub(super) fn new(n_samples: usize, n_axes: usize) -> Self {
        Self { n_axes, n_samples, edges: edges(n_samples), fft: Fft::new(n_samples) }
    }
}

impl Statistic for Spectrum {
    type Work = SpectrumWork;

    fn n_features(&self) -> usize {
        self.n_axes * (self.edges.len() - 1)
    }

    /// Room, and the window of whole recordings.
    fn work(&self) -> SpectrumWork {
        // Whole vectors of the frequencies up to half of the rate, and one that begins at the last.
        let powers = vec![0.0; (self.n_samples / 2 + 1).next_multiple_of(LANES) + LANES];
        let mut work = SpectrumWork {
            transform: self.fft.work(),
            powers: std::array::from_fn(|_| powers.clone()),
            window: Vec::with_capacity(self.n_samples),
            weight: 0.0,
        };
        work.open(self.n_samples);
        work
    }

    /// Axis by axis the logarithms of the pooled powers of band 0, which is the mean-free signal; a beginning of a recording
    /// is followed by zeros.
    #[inline(always)]
    fn compute(&self, simd: impl Simd, split: Split<'_>, work: &mut SpectrumWork, out: &mut [f64]) {
        if work.window.len() != split.signals.len(0) {
            work.open(split.signals.len(0));
        }
        let (n, per_axis) = (self.n_samples, self.edges.len() - 1);
        let SpectrumWork { transform, powers, window, weight } = work;
        for first in (0..self.n_axes).step_by(AXES) {
            let axes = first..self.n_axes.min(first + AXES);
            // Two axes are one complex signal.
            for (pair, [even, odd]) in axes.clone().step_by(2).zip(powers.as_chunks_mut().0) {
                let [re, im] = [pair, (pair + 1).min(axes.end - 1)].map(|axis| split.signals.axis(0, axis));
                self.fft.process(simd, [re, im, window], transform);
                measure(simd, &transform.transform, n, even, odd);
            }
            for (bin, range) in self.edges.windows(2).enumerate() {
                let share = 0.25 / (*weight * (range[1] - range[0]) as f64);
                let sums = pooled(simd, powers, range[0]..range[1]);
                for (axis, power) in axes.clone().zip(sums) {
                    out[axis * per_axis + bin] = power.value() * share + FLOOR;
                }
            }
        }
        each::<Log, LANES>(out);
    }
}

impl SpectrumWork {
    /// Makes `window` the Hann window of `n` samples. Its ends lie half a sample outside, so that no sample is lost.
    #[cold]
    #[inline(never)]
    fn open(&mut self, n: usize) {
        self.window.clear();
        let at = |t: usize| 0.5 - 0.5 * libm::cos(2.0 * PI * (t as f64 + 0.5) / n as f64);
        self.window.extend((0..n).map(|t| f32::of(at(t))));
        self.weight = (0..n).fold(0.0, |sum, t| sum + at(t) * at(t));
    }
}

/// First FFT bin of each pooled bin, then the end: geometric, but at least [`MIN_WIDTH`] apart; a shorter rest joins the
/// last.
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // at most n_samples
fn edges(n_samples: usize) -> Vec<usize> {
    let end = n_samples / 2 + 1;
    let mut edges = vec![1];
    for i in 1..=BINS {
        let edge = libm::rint(libm::pow(end as f64, i as f64 / BINS as f64)) as usize;
        if edge >= edges[edges.len() - 1] + MIN_WIDTH {
            edges.push(edge);
        }
    }
    if edges[edges.len() - 1] != end {
        edges.truncate((edges.len() - 1).max(1));
        edges.push(end);
    }
    edges
}

/// Four times the powers of the signal that is the real part, and of the one that is the imaginary part; that of frequency
/// zero is not there. Both are scaled: each takes on rounding errors of the other.
#[inline(always)]
fn measure(
    simd: impl Vectors<f32, LANES>,
    transform: &ComplexValues,
    n: usize,
    real: &mut [f32],
    imaginary: &mut [f32],
) {
    let ComplexValues { re, im } = transform;
    let there = re.as_chunks::<LANES>().0.iter().zip(im.as_chunks::<LANES>().0);
    let back = re[..=n].rchunks_exact(LANES).zip(im[..=n].rchunks_exact(LANES));
    let outs = real.as_chunks_mut::<LANES>().0.iter_mut().zip(imaginary.as_chunks_mut::<LANES>().0);
    for ((there, back), (real, imaginary)) in there.zip(back).zip(outs) {
        let (a_re, a_im) = (simd.load(there.0), simd.load(there.1));
        let (b_re, b_im) = (simd.load(back.0).reversed(), simd.load(back.1).reversed());
        let (p, q) = (a_re + b_re, a_im - b_im);
        (p * p + q * q).store(real);
        let (p, q) = (a_im + b_im, a_re - b_re);
        (p * p + q * q).store(imaginary);
    }
}

/// Sums over some frequencies, axis by axis.
#[inline(always)]
fn pooled(simd: impl Vectors<f32, LANES>, powers: &[Vec<f32>; AXES], bin: Range<usize>) -> [f32; AXES] {
    const THERE: [f32; 2 * LANES] =
        [1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
    let zero = simd.splat(0.0);
    let n_whole = bin.len() / LANES;
    let there = simd.load(&THERE[LANES - bin.len() % LANES..]).above(zero);
    let mut sums = [zero; AXES];
    for (sum, powers) in sums.iter_mut().zip(powers) {
        let powers = &powers[bin.start..];
        *sum = there.select(simd.load(&powers[n_whole * LANES..]), zero);
        for powers in &powers.as_chunks::<LANES>().0[..n_whole] {
            *sum = *sum + simd.load(powers);
        }
    }
    let mut rows = Register::transposed(sums);
    for half in [4, 2, 1] {
        for l in 0..half {
            rows[l] = rows[l] + rows[l + half];
        }
    }
    let mut out = [0.0; AXES];
    rows[0].store(&mut out);
    out
}

#[cfg(test)]
mod tests {
    use super::super::tests::{same_on_every_path, Signals};
    use super::*;
    use crate::kernel::SimdPath;

    fn compute(path: SimdPath, signals: &Signals) -> Vec<f64> {
        signals.compute(&Spectrum::new(signals.lengths()[0], signals.n_axes), path)
    }

    #[test]
    fn every_path_gives_the_same_bits() {
        same_on_every_path(compute);
    }

    #[test]
    fn bins_ascend_to_the_end() {
        for n in 4..3000 {
            let edges = edges(n);
            assert_eq!((edges[0], edges[edges.len() - 1]), (1, n / 2 + 1));
            assert!(
                edges.len() == 2 || edges.windows(2).all(|pair| pair[1] - pair[0] >= MIN_WIDTH),
                "{n}: {edges:?}"
            );
        }
    }

    #[test]
    fn a_sine_is_one_peak() {
        let sine = |t: usize| f32::of((2.0 * PI * 100.0 * t as f64 / 1600.0).sin());
        let signals =
            Signals::from(vec![vec![(0..1600).map(sine).collect(), vec![0.0; 1600], vec![1e-3; 1600]]]);
        let got = compute(SimdPath::detect().unwrap(), &signals);
        let edges = edges(1600);
        let bin = edges.iter().rposition(|edge| *edge <= 100).unwrap();
        let (first, others) = got.split_at(edges.len() - 1);
        for (i, power) in first.iter().enumerate() {
            assert!((i == bin) == (*power > 1.0), "{i} {power}");
        }
        assert!(others[..edges.len() - 1].iter().all(|power| (power - FLOOR.ln()).abs() < 1e-6));
    }

    #[test]
    fn a_beginning_is_followed_by_zeros() {
        let (design, path) = (Spectrum::new(200, 1), SimdPath::detect().unwrap());
        let mut work = design.work();
        let short = Signals::new(&[77], 1).compute_in(&design, path, &mut work);
        let long = Signals::new(&[200], 1).compute_in(&design, path, &mut work);
        assert!(short.iter().all(|x| x.is_finite()));
        assert_eq!(long, compute(path, &Signals::new(&[200], 1)));
    }
}
