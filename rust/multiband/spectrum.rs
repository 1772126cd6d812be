//! Power over frequency: the Hann periodogram of the mean-free signal, pooled into bins of nearly equal ratio.
//!
//! Four axes are transformed as one: [`rustfft`] takes four float32 side by side for a number, and four transforms take the
//! time of little more than one.

use std::f64::consts::PI;
use std::fmt;
use std::ops::{Add, Div, Mul, Neg, Rem, Sub};
use std::sync::Arc;

use rustfft::num_complex::Complex;
use rustfft::num_traits::{FromPrimitive, Num, One, Signed, Zero};
use rustfft::{Fft, FftPlannerScalar};

use super::{narrow, Split, Statistic};
use crate::kernel::Simd;

/// Pooled bins at most.
const BINS: usize = 40;

/// Frequencies per bin at least; the logarithm of fewer is mostly chance.
const MIN_WIDTH: usize = 3;

/// Samples from which on there are more bins than octaves. A coarser spectrum only repeats the envelope.
pub(super) const LEAST_SAMPLES: usize = 18;

/// Added to scaled powers before the logarithm.
const FLOOR: f64 = 1e-6;

/// Axes that are transformed at a time.
const AXES: usize = 2 * QUAD;

/// The statistic for signals of some length.
#[derive(Clone)]
pub(super) struct Spectrum {
    n_axes: usize,
    /// First frequency of each bin, then one past the last, in steps of the transform.
    pub(super) edges: Vec<usize>,
    // The scalar one: others use fused multiply-add where a machine has it, and their last bits differ.
    fft: Arc<dyn Fft<Quad>>,
}

impl fmt::Debug for Spectrum {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Spectrum").field("n_axes", &self.n_axes).finish_non_exhaustive()
    }
}

/// What one thread needs to compute it.
#[derive(Clone, Debug)]
pub(super) struct SpectrumWork {
    transform: Vec<Complex<Quad>>,
    scratch: Vec<Complex<Quad>>,
    /// The window of the length that came last, and the sum of its squares.
    window: Vec<f32>,
    weight: f64,
}

impl Spectrum {
    pub(super) fn new(n_samples: usize, n_axes: usize) -> Self {
        let fft = FftPlannerScalar::new().plan_fft_forward(n_samples);
        Self { n_axes, edges: edges(n_samples), fft }
    }
}

impl Statistic for Spectrum {
    type Work = SpectrumWork;

    fn n_features(&self) -> usize {
        self.n_axes * (self.edges.len() - 1)
    }

    /// Room, and the window of whole recordings.
    fn work(&self) -> SpectrumWork {
        let room = |n| vec![Complex::default(); n];
        let n_samples = self.fft.len();
        let mut work = SpectrumWork {
            transform: room(n_samples),
            scratch: room(self.fft.get_inplace_scratch_len()),
            window: Vec::with_capacity(n_samples),
            weight: 0.0,
        };
        work.set_window(n_samples);
        work
    }

    /// Axis by axis the logarithms of the pooled powers of band 0, which is the mean-free signal; a beginning of a recording
    /// is followed by zeros.
    #[inline(always)]
    fn compute(&self, _simd: impl Simd, split: Split<'_>, work: &mut SpectrumWork, out: &mut [f64]) {
        if work.window.len() != split.signals.len(0) {
            work.set_window(split.signals.len(0));
        }
        let SpectrumWork { transform, scratch, window, weight } = work;
        let per_axis = self.edges.len() - 1;
        for (group, out) in out.chunks_mut(AXES * per_axis).enumerate() {
            // Two axes are one complex signal. Lanes without an axis take the last one.
            let mut signals = [&[][..]; AXES];
            for (l, signal) in signals.iter_mut().enumerate() {
                *signal = &split.signals.axis(0, (group * AXES + l).min(self.n_axes - 1))[..window.len()];
            }
            transform[window.len()..].fill(Complex::default());
            for (t, (z, window)) in transform.iter_mut().zip(&*window).enumerate() {
                for l in 0..QUAD {
                    z.re.0[l] = signals[2 * l][t] * window;
                    z.im.0[l] = signals[2 * l + 1][t] * window;
                }
            }
            self.fft.process_with_scratch(transform, scratch);
            for (bin, range) in self.edges.windows(2).enumerate() {
                let share = 0.25 / (*weight * (range[1] - range[0]) as f64);
                let mut sums = [[0.0; QUAD]; 2];
                let back = transform.iter().rev().skip(range[0] - 1);
                for (there, back) in transform[range[0]..range[1]].iter().zip(back) {
                    for (sums, powers) in sums.iter_mut().zip(powers_of_both(*there, *back)) {
                        for (sum, power) in sums.iter_mut().zip(powers.0) {
                            *sum += f64::from(power);
                        }
                    }
                }
                for (axis, out) in out.chunks_mut(per_axis).enumerate() {
                    out[bin] = libm::log(sums[axis % 2][axis / 2] * share + FLOOR);
                }
            }
        }
    }
}

/// Four times the power of the signal that is the real part, and of the one that is the imaginary part, of a frequency of
/// their transform and the same frequency counted from the end. Both are scaled: each takes on rounding errors of the other.
#[inline(always)]
fn powers_of_both(there: Complex<Quad>, back: Complex<Quad>) -> [Quad; 2] {
    let [re, im] = [there.re + back.re, there.im - back.im];
    let [other_re, other_im] = [there.im + back.im, there.re - back.re];
    [re * re + im * im, other_re * other_re + other_im * other_im]
}

impl SpectrumWork {
    /// Makes `window` the Hann window of `n` samples. Its ends lie half a sample outside, so that no sample is lost.
    #[cold]
    #[inline(never)]
    fn set_window(&mut self, n: usize) {
        self.window.clear();
        let at = |t: usize| 0.5 - 0.5 * libm::cos(2.0 * PI * (t as f64 + 0.5) / n as f64);
        self.window.extend((0..n).map(|t| narrow(at(t))));
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

/// Lanes of a [`Quad`].
const QUAD: usize = 4;

/// Four numbers; every operation is that of each lane.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[repr(C, align(16))]
struct Quad([f32; QUAD]);

macro_rules! operators {
    ($($operator:ident $method:ident $sign:tt),*) => {$(
        impl $operator for Quad {
            type Output = Self;

            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                let mut out = self;
                for l in 0..QUAD {
                    out.0[l] = self.0[l] $sign other.0[l];
                }
                out
            }
        }
    )*};
}

operators!(Add add +, Sub sub -, Mul mul *, Div div /, Rem rem %);

impl Neg for Quad {
    type Output = Self;

    #[inline(always)]
    fn neg(self) -> Self {
        Self(self.0.map(|x| -x))
    }
}

impl Zero for Quad {
    fn zero() -> Self {
        Self::default()
    }

    fn is_zero(&self) -> bool {
        *self == Self::default()
    }
}

impl One for Quad {
    fn one() -> Self {
        Self([1.0; QUAD])
    }
}

impl FromPrimitive for Quad {
    fn from_i64(n: i64) -> Option<Self> {
        f32::from_i64(n).map(|x| Self([x; QUAD]))
    }

    fn from_u64(n: u64) -> Option<Self> {
        f32::from_u64(n).map(|x| Self([x; QUAD]))
    }

    fn from_f64(x: f64) -> Option<Self> {
        Some(Self([narrow(x); QUAD]))
    }
}

// A transform calls none of these: they make a number of a Quad.
impl Num for Quad {
    type FromStrRadixErr = <f32 as Num>::FromStrRadixErr;

    fn from_str_radix(text: &str, radix: u32) -> Result<Self, Self::FromStrRadixErr> {
        f32::from_str_radix(text, radix).map(|x| Self([x; QUAD]))
    }
}

impl Signed for Quad {
    fn abs(&self) -> Self {
        Self(self.0.map(f32::abs))
    }

    fn abs_sub(&self, other: &Self) -> Self {
        (*self - *other).abs()
    }

    fn signum(&self) -> Self {
        Self(self.0.map(f32::signum))
    }

    fn is_positive(&self) -> bool {
        self.0.iter().all(|x| *x > 0.0)
    }

    fn is_negative(&self) -> bool {
        self.0.iter().all(|x| *x < 0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

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
}
