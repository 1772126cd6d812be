//! Power over frequency: the Hann periodogram of the mean-free signal, pooled into bins of nearly equal ratio.

use std::f64::consts::PI;

use super::bank::BandSignals;
use super::butterfly::Complex;
use super::fft::Fft;
use super::logarithm::{self, Log};
use super::pack::Pack;
use crate::lanes::{Isa, Job, Path};

/// Pooled bins at most.
const BINS: usize = 40;

/// Frequencies per bin at least; the logarithm of fewer is mostly chance.
const MIN_WIDTH: usize = 3;

/// Samples from which on there are more bins than octaves. A coarser spectrum only repeats the envelope.
pub(super) const LEAST_SAMPLES: usize = 18;

/// Added to scaled powers before the logarithm.
const FLOOR: f64 = 1e-6;

/// Complex signals at once, each of two axes.
const LANES: usize = 4;

/// The statistic for signals of some length.
#[derive(Clone, Debug)]
pub(super) struct Spectrum {
    n_axes: usize,
    n_samples: usize,
    edges: Vec<usize>,
    fft: Fft,
}

/// What one thread needs to compute it.
#[derive(Clone, Debug)]
pub(super) struct SpectrumWork {
    values: Vec<Complex<LANES>>,
    other: Vec<Complex<LANES>>,
    /// The window of the length that came last, and the sum of its squares.
    window: Vec<f64>,
    weight: f64,
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

impl Spectrum {
    pub(super) fn new(n_samples: usize, n_axes: usize) -> Self {
        Self { n_axes, n_samples, edges: edges(n_samples), fft: Fft::new(n_samples) }
    }

    /// First frequency of each bin, then one past the last, in steps of the transform.
    pub(super) fn edges(&self) -> &[usize] {
        &self.edges
    }

    /// Pooled bins.
    pub(super) fn per_axis(&self) -> usize {
        self.edges.len() - 1
    }

    pub(super) fn n_features(&self) -> usize {
        self.n_axes * self.per_axis()
    }

    /// Room, and the window of whole recordings.
    pub(super) fn work(&self) -> SpectrumWork {
        let room = vec![Complex::ZERO; self.fft.room()];
        let window = Vec::with_capacity(self.n_samples);
        let mut work = SpectrumWork { values: room.clone(), other: room, window, weight: 0.0 };
        work.open(self.n_samples);
        work
    }

    /// Axis by axis the logarithms of the pooled powers of band 0, which is the mean-free signal; a beginning of a recording
    /// is followed by zeros. Allocates nothing.
    pub(super) fn compute(
        &self,
        path: Path,
        signals: BandSignals<'_>,
        work: &mut SpectrumWork,
        out: &mut [f64],
    ) {
        if work.window.len() != signals.len(0) {
            work.open(signals.len(0));
        }
        path.run(Compute { design: self, signals, work, out });
    }
}

impl SpectrumWork {
    /// Makes `window` the Hann window of `n` samples. Its ends lie half a sample outside, so that no sample is lost.
    fn open(&mut self, n: usize) {
        self.window.clear();
        self.window.extend((0..n).map(|t| 0.5 - 0.5 * libm::cos(2.0 * PI * (t as f64 + 0.5) / n as f64)));
        self.weight = self.window.iter().fold(0.0, |sum, w| sum + w * w);
    }
}

struct Compute<'a> {
    design: &'a Spectrum,
    signals: BandSignals<'a>,
    work: &'a mut SpectrumWork,
    out: &'a mut [f64],
}

impl Job for Compute<'_> {
    type Output = ();

    #[inline(always)]
    fn run<I: Isa>(self) {
        let Self { design, signals, work, out } = self;
        let (n, per_axis) = (design.n_samples, design.per_axis());
        let SpectrumWork { values, other, window, weight } = work;
        for first in (0..design.n_axes).step_by(2 * LANES) {
            let axes = first..design.n_axes.min(first + 2 * LANES);
            pack::<I>(signals, window, axes.clone(), values);
            values[window.len()..n].fill(Complex::ZERO);
            design.fft.process(values, other);
            for (bin, range) in design.edges.windows(2).enumerate() {
                let share = 4.0 * *weight * (range[1] - range[0]) as f64;
                let powers = pooled(&values[..n], range[0]..range[1]);
                for axis in axes.clone() {
                    let power = powers[axis % 2].0[(axis - first) / 2];
                    out[axis * per_axis + bin] = power / share + FLOOR;
                }
            }
        }
        logarithm::each::<Log, LANES>(out);
    }
}

/// Windowed, two axes as one complex signal. Both are scaled: each takes on rounding errors of the other.
#[inline(always)]
fn pack<I: Isa>(
    signals: BandSignals<'_>,
    window: &[f64],
    axes: std::ops::Range<usize>,
    values: &mut [Complex<LANES>],
) {
    // Axes that there are not are silent.
    let signal = |axis: usize| if axes.contains(&axis) { signals.axis(0, axis) } else { &[] };
    for part in [0, 1] {
        let lanes: [&[f64]; LANES] = std::array::from_fn(|lane| signal(axes.start + 2 * lane + part));
        let blocks = lanes.map(|lane| lane.as_chunks().0);
        let mut last = [[0.0; LANES]; LANES];
        for (last, lane) in last.iter_mut().zip(lanes) {
            let rest = lane.as_chunks::<LANES>().1;
            last[..rest.len()].copy_from_slice(rest);
        }
        for (t, (values, window)) in values.chunks_mut(LANES).zip(window.chunks(LANES)).enumerate() {
            let mut samples = [&last[0], &last[1], &last[2], &last[3]];
            if window.len() == LANES {
                for l in 0..LANES {
                    samples[l] = blocks[l].get(t).unwrap_or(&[0.0; LANES]);
                }
            }
            for ((value, w), sample) in values.iter_mut().zip(window).zip(I::transpose4(samples)) {
                let sample = Pack(sample) * Pack::splat(*w);
                if part == 0 {
                    value.re = sample;
                } else {
                    value.im = sample;
                }
            }
        }
    }
}

/// Four times the sum of the powers of some frequencies, of the real parts of the signals and of their imaginary parts.
#[inline(always)]
fn pooled(values: &[Complex<LANES>], frequencies: std::ops::Range<usize>) -> [Pack<LANES>; 2] {
    let n = values.len();
    let mut sums = [Pack::ZERO; 2];
    for k in frequencies {
        let (a, b) = (values[k], values[(n - k) % n]);
        let (p, q) = (a.re + b.re, a.im - b.im);
        sums[0] = sums[0] + (p * p + q * q);
        let (p, q) = (a.im + b.im, a.re - b.re);
        sums[1] = sums[1] + (p * p + q * q);
    }
    sums
}

#[cfg(test)]
mod tests {
    use super::super::signals::{same_on_every_path, Signals};
    use super::*;

    fn compute(path: Path, signals: &Signals) -> Vec<f64> {
        let design = Spectrum::new(signals.lengths()[0], signals.n_axes());
        let mut out = vec![0.0; design.n_features()];
        design.compute(path, signals.view(), &mut design.work(), &mut out);
        out
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
        let got = compute(Path::detect(), &signals);
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
        let design = Spectrum::new(200, 1);
        let signals = Signals::new(&[77], 1);
        let (mut short, mut long) = (vec![0.0; design.n_features()], vec![0.0; design.n_features()]);
        let mut work = design.work();
        design.compute(Path::detect(), signals.view(), &mut work, &mut short);
        design.compute(Path::detect(), Signals::new(&[200], 1).view(), &mut work, &mut long);
        assert!(short.iter().all(|x| x.is_finite()));
        assert_eq!(long, compute(Path::detect(), &Signals::new(&[200], 1)));
    }
}
