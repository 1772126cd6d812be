//! Power over frequency: the Hann periodogram of the mean-free signal, pooled into bins of nearly equal ratio.

use std::f64::consts::PI;
use std::ops::Range;

use super::fft::{ComplexValues, Fft, FftWork, LANES};
use super::logarithm::{each, Log};
use super::{Split, Statistic};
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
const AXES: usize = 8;

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
    powers: [Vec<f64>; AXES],
    /// The window of the length that came last, and the sum of its squares.
    window: Vec<f64>,
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
        // Whole vectors of the frequencies up to half of the rate.
        let powers = vec![0.0; (self.n_samples / 2 + 1).next_multiple_of(LANES)];
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
                let ComplexValues { re, im } = &mut transform.signal;
                open(split.signals.axis(0, pair), window, &mut re[..n]);
                if pair + 1 < axes.end {
                    open(split.signals.axis(0, pair + 1), window, &mut im[..n]);
                } else {
                    im.fill(0.0);
                }
                self.fft.process(simd, transform);
                measure(simd, &transform.signal, n, even, odd);
            }
            for (bin, range) in self.edges.windows(2).enumerate() {
                let share = 4.0 * *weight * (range[1] - range[0]) as f64;
                let sums = pooled(powers, range[0]..range[1]);
                for (axis, power) in axes.clone().zip(sums) {
                    out[axis * per_axis + bin] = power / share + FLOOR;
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
        self.window.extend((0..n).map(|t| 0.5 - 0.5 * libm::cos(2.0 * PI * (t as f64 + 0.5) / n as f64)));
        self.weight = self.window.iter().fold(0.0, |sum, w| sum + w * w);
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

/// A signal behind its window, and silence after it.
#[inline(always)]
fn open(signal: &[f64], window: &[f64], out: &mut [f64]) {
    let (there, after) = out.split_at_mut(signal.len());
    for ((out, x), w) in there.iter_mut().zip(signal).zip(window) {
        *out = x * w;
    }
    after.fill(0.0);
}

/// Four times the powers of the signal that is the real part, and of the one that is the imaginary part; that of frequency
/// zero is not there. Both are scaled: each takes on rounding errors of the other.
#[inline(always)]
fn measure(
    simd: impl Vectors<f64, 4>,
    transform: &ComplexValues,
    n: usize,
    real: &mut [f64],
    imaginary: &mut [f64],
) {
    let outs = real.as_chunks_mut::<LANES>().0.iter_mut().zip(imaginary.as_chunks_mut::<LANES>().0);
    for (i, (real, imaginary)) in outs.enumerate() {
        let k = i * LANES;
        let (a, b) = (transform.load(simd, k), transform.load(simd, n - k - (LANES - 1)));
        let (re, im) = (b.re.reversed(), b.im.reversed());
        let (p, q) = (a.re + re, a.im - im);
        (p * p + q * q).store(real);
        let (p, q) = (a.im + im, a.re - re);
        (p * p + q * q).store(imaginary);
    }
}

/// Sums over some frequencies, axis by axis: side by side, because each has to wait for itself.
#[inline(always)]
fn pooled(powers: &[Vec<f64>; AXES], frequencies: Range<usize>) -> [f64; AXES] {
    let mut sums = [0.0; AXES];
    let powers = powers.each_ref().map(|powers| &powers[frequencies.clone()]);
    for k in 0..frequencies.len() {
        for (sum, powers) in sums.iter_mut().zip(powers) {
            *sum += powers[k];
        }
    }
    sums
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
        let sine = |t: usize| (2.0 * PI * 100.0 * t as f64 / 1600.0).sin();
        let signals =
            Signals::from(vec![vec![(0..1600).map(sine).collect(), vec![0.0; 1600], vec![1e-3; 1600]]]);
        let got = compute(SimdPath::detect().unwrap(), &signals);
        let edges = edges(1600);
        let bin = edges.iter().rposition(|edge| *edge <= 100).unwrap();
        let (first, others) = got.split_at(edges.len() - 1);
        for (i, power) in first.iter().enumerate() {
            assert!((i == bin) == (*power > 1.0), "{i} {power}");
        }
        assert!(others[..edges.len() - 1].iter().all(|power| (power - FLOOR.ln()).abs() < 1e-9));
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
