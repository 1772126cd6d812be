//! Butterworth filters as second-order sections.
//!
//! Classic design: poles of the analog low-pass on the unit circle, moved to the wanted band at pre-warped
//! frequencies, brought to the z-plane by the bilinear transform, and paired as `scipy.signal.zpk2sos` does. The result
//! equals `scipy.signal.butter(order, edges, band, fs=rate_hz, output="sos")` section by section. Transcendental
//! functions come from the `libm` crate, so that every machine has the same coefficients.
//!
//! Two pairs of poles of a band that lies symmetrically about a quarter of the sampling rate are equally far from the
//! unit circle. There rounding decides which section comes first, here and in scipy, and the two may differ.

use std::f64::consts::PI;

use super::pairing::{to_rows, Complex};
use super::Sos;
use crate::error::{short_number, Error, Result};

/// The highest order that can be designed.
pub const MAX_ORDER: usize = 32;

/// What a filter lets pass; edges in hertz, at which the magnitude is down by 3 dB.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum Band {
    /// Everything below the cut-off.
    Lowpass(f64),
    /// Everything above the cut-off.
    Highpass(f64),
    /// Everything between a low and a high edge.
    Bandpass(f64, f64),
    /// Everything but what lies between a low and a high edge.
    Bandstop(f64, f64),
}

/// An analog filter.
struct Analog {
    /// Finite zeros, as many as the order or twice as many; none for a low-pass.
    zeros: Vec<Complex>,
    /// As many as the order, or twice as many.
    poles: Vec<Complex>,
    /// The gain is this number to the power of the order.
    gain_root: f64,
}

/// Designs a digital Butterworth filter.
///
/// # Arguments
/// - `order`: order of the low-pass prototype, 1 to [`MAX_ORDER`]; a band-pass or band-stop has twice as many poles.
/// - `band`: what passes, with edges in hertz inside the open interval (0, `rate_hz` / 2).
/// - `rate_hz`: sampling rate in hertz.
///
/// # Errors
/// [`Error::Range`] and [`Error::Argument`] name the argument that is out of range; also `order` and `sos` where the
/// numbers are allowed one by one, yet the band is so narrow or so close to an end of the spectrum that float64 cannot hold
/// the filter.
///
/// # Example
/// ```
/// use granular_id::{butterworth, Band};
///
/// let sos = butterworth(8, Band::Highpass(23.0), 500.0)?;
/// assert_eq!(sos.sections().len(), 4);
/// # Ok::<(), granular_id::Error>(())
/// ```
pub fn butterworth(order: usize, band: Band, rate_hz: f64) -> Result<Sos> {
    Error::check_range("order", order, 1..=MAX_ORDER)?;
    Error::check_rate(rate_hz)?;
    check_edges(band, rate_hz)?;
    let warp = |f: f64| 4.0 * libm::tan(PI * (f / (rate_hz / 2.0)) / 2.0);
    let analog = match band {
        Band::Lowpass(cutoff) => lowpass(&prototype(order), warp(cutoff)),
        Band::Highpass(cutoff) => highpass(&prototype(order), warp(cutoff)),
        Band::Bandpass(low, high) => bandpass(&prototype(order), warp(low), warp(high)),
        Band::Bandstop(low, high) => bandstop(&prototype(order), warp(low), warp(high)),
    };
    let (zeros, poles, gain) = bilinear(&analog, order);
    let finite = zeros.iter().chain(&poles).all(|root| root.is_finite());
    if !(finite && gain.is_normal()) {
        let wanted = "be lower for so narrow or extreme a band";
        let got = format_args!("{order}: the gain, {gain:e}, leaves float64");
        return Err(Error::argument("order", wanted, got));
    }
    Sos::new(&to_rows(&zeros, &poles, gain))
}

fn check_edges(band: Band, rate_hz: f64) -> Result<()> {
    let inside = |cutoff_hz: f64| {
        if cutoff_hz > 0.0 && cutoff_hz < rate_hz / 2.0 {
            Ok(())
        } else {
            let wanted = format_args!("be in (0, rate_hz / 2) = (0, {})", short_number(rate_hz / 2.0));
            let got = format_args!("{} at rate_hz = {}", short_number(cutoff_hz), short_number(rate_hz));
            Err(Error::argument("cutoff_hz", wanted, got))
        }
    };
    match band {
        Band::Lowpass(cutoff) | Band::Highpass(cutoff) => inside(cutoff),
        Band::Bandpass(low_hz, high_hz) | Band::Bandstop(low_hz, high_hz) => {
            inside(low_hz)?;
            inside(high_hz)?;
            if low_hz < high_hz {
                Ok(())
            } else {
                let (low, high) = (short_number(low_hz), short_number(high_hz));
                let got = format_args!("low = {low} and high = {high}");
                Err(Error::argument("band edges", "satisfy low < high", got))
            }
        }
    }
}

/// Poles of the analog low-pass with cut-off 1 rad/s: evenly spaced on the left half of the unit circle.
fn prototype(order: usize) -> Vec<Complex> {
    let n = order as f64;
    (0..order)
        .map(|i| {
            let angle = PI * (2.0 * i as f64 + 1.0 - n) / (2.0 * n);
            // The middle pole of an odd order has angle 0 and is real exactly.
            Complex::new(-libm::cos(angle), -libm::sin(angle))
        })
        .collect()
}

fn lowpass(prototype: &[Complex], cutoff: f64) -> Analog {
    let poles = prototype.iter().map(|p| p.scale(cutoff)).collect();
    Analog { zeros: Vec::new(), poles, gain_root: cutoff }
}

fn highpass(prototype: &[Complex], cutoff: f64) -> Analog {
    let poles = prototype.iter().map(|&p| Complex::real(cutoff) / p).collect();
    // The prototype's poles multiply to magnitude 1, so inverting them leaves the gain alone.
    Analog { zeros: vec![Complex::ZERO; prototype.len()], poles, gain_root: 1.0 }
}

fn bandpass(prototype: &[Complex], low: f64, high: f64) -> Analog {
    let (width, centre) = (high - low, (low * high).sqrt());
    let scaled: Vec<_> = prototype.iter().map(|p| p.scale(width).scale(0.5)).collect();
    Analog { zeros: vec![Complex::ZERO; prototype.len()], poles: shifted(&scaled, centre), gain_root: width }
}

fn bandstop(prototype: &[Complex], low: f64, high: f64) -> Analog {
    let (width, centre) = (high - low, (low * high).sqrt());
    let inverted: Vec<_> = prototype.iter().map(|&p| Complex::real(width / 2.0) / p).collect();
    let (n, notch) = (prototype.len(), Complex::new(0.0, centre));
    let zeros = [vec![notch; n], vec![notch.conj(); n]].concat();
    Analog { zeros, poles: shifted(&inverted, centre), gain_root: 1.0 }
}

/// Moves each pole from around zero to around plus and minus `centre`.
fn shifted(poles: &[Complex], centre: f64) -> Vec<Complex> {
    let offset = |p: Complex| (p * p - Complex::real(centre * centre)).sqrt();
    let up = poles.iter().map(|&p| p + offset(p));
    let down = poles.iter().map(|&p| p - offset(p));
    up.chain(down).collect()
}

/// Zeros, poles and gain in the z-plane, at 2 samples per second; zeros at infinity go to the Nyquist frequency.
fn bilinear(analog: &Analog, order: usize) -> (Vec<Complex>, Vec<Complex>, f64) {
    let four = Complex::real(4.0);
    let map = |&root: &Complex| (four + root) / (four - root);
    let mut zeros: Vec<_> = analog.zeros.iter().map(map).collect();
    zeros.resize(analog.poles.len(), Complex::real(-1.0));
    let poles = analog.poles.iter().map(map).collect();
    // One factor per order at a time: products over all roots would overflow long before their ratio does.
    let mut gain = Complex::ONE;
    for i in 0..order {
        gain = gain.scale(analog.gain_root);
        for j in [i, i + order] {
            if let Some(&zero) = analog.zeros.get(j) {
                gain = gain * (four - zero);
            }
            if let Some(&pole) = analog.poles.get(j) {
                gain = gain / (four - pole);
            }
        }
    }
    (zeros, poles, gain.re)
}
