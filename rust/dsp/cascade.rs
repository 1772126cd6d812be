//! The inner loops of the filter: transposed direct form II, in exactly one order of operations.
//!
//! No fused multiply-add and no other order than that of [`advance`], so that every path, and the compiled loop of
//! `scipy.signal.sosfilt` on x86-64, gives the same bits. Sections only see the output of the section before them and
//! channels do not see each other, so the order in which sections and channels are visited changes no bit.
//!
//! Subnormal numbers are kept, because flushing them to zero would change bits. That costs little: the loops are bound
//! by the latency of the recurrence. The tail of the 8th-order high-pass, which never quite dies (rounding keeps it
//! circling a few units of 2^-1074), runs at 1.1 times the time of noise for one channel and 1.5 times for six on AMD
//! Zen 3. Machines that handle subnormals in microcode may take longer.

use crate::dsp::Section;

/// Samples that one group of sections filters before the next group takes over; they stay in the first-level cache.
const STRETCH: usize = 1024;

/// Sections whose coefficients and states one loop keeps at hand.
const WIDEST: usize = 8;

/// One sample through one section: the one order of operations. `steps` below and `kernel::filter::step` write the same
/// operations out over arrays, for speed; tests hold all three to the same bits.
#[inline(always)]
#[allow(clippy::inline_always)] // a call in the innermost loop would cost more than the section
fn advance(s: &Section, [z0, z1]: [f64; 2], x: f64) -> (f64, [f64; 2]) {
    let y = s.b0 * x + z0;
    (y, [s.b1 * x - s.a1 * y + z1, s.b2 * x - s.a2 * y])
}

/// Filters one channel in place; `state` holds `[z0, z1]` per section.
pub(crate) fn one_channel(sections: &[Section], state: &mut [f64], x: &mut [f64]) {
    let (state, _) = state.as_chunks_mut::<2>();
    let stretch = if sections.len() <= WIDEST { x.len().max(1) } else { STRETCH };
    for x in x.chunks_mut(stretch) {
        for (sections, state) in sections.chunks(WIDEST).zip(state.chunks_mut(WIDEST)) {
            match sections.len() {
                1 => wavefront::<1>(sections, state, x),
                2 => wavefront::<2>(sections, state, x),
                3 => wavefront::<3>(sections, state, x),
                4 => wavefront::<4>(sections, state, x),
                5 => wavefront::<5>(sections, state, x),
                6 => wavefront::<6>(sections, state, x),
                7 => wavefront::<7>(sections, state, x),
                _ => wavefront::<8>(sections, state, x),
            }
        }
    }
}

/// Runs `N` sections at once, each one sample behind the section before it.
///
/// Then no section waits for another within a step, and the compiler packs neighbouring sections into vectors.
fn wavefront<const N: usize>(sections: &[Section], state: &mut [[f64; 2]], x: &mut [f64]) {
    let (Some(s), Some(z)) = (sections.first_chunk::<N>(), state.first_chunk_mut::<N>()) else {
        return;
    };
    let lag = N - 1;
    if x.len() <= lag {
        for x in x {
            for (s, z) in s.iter().zip(z.iter_mut()) {
                (*x, *z) = advance(s, *z, *x);
            }
        }
        return;
    }
    let mut y = [0.0; N];
    // The first samples reach one more section with every step ...
    for (reached, &x) in x[..lag].iter().enumerate() {
        for i in (0..=reached).rev() {
            (y[i], z[i]) = advance(&s[i], z[i], if i == 0 { x } else { y[i - 1] });
        }
    }
    y = steps(s, z, y, x);
    // ... and the last ones leave them one by one.
    let tail = x.len() - lag;
    for (left, x) in x[tail..].iter_mut().enumerate() {
        for i in (left + 1..N).rev() {
            (y[i], z[i]) = advance(&s[i], z[i], y[i - 1]);
        }
        *x = y[lag];
    }
}

/// The steps in which every section has a sample; returns what each section gave last.
///
/// Never inlined: beside other code the loop does not keep its state in registers and takes half as long again.
#[inline(never)]
fn steps<const N: usize>(
    s: &[Section; N],
    z: &mut [[f64; 2]; N],
    mut last: [f64; N],
    x: &mut [f64],
) -> [f64; N] {
    let lag = N - 1;
    // Copies on the stack, which a write through `x` cannot change: they may stay in registers.
    let (b0, b1, b2) = (s.map(|s| s.b0), s.map(|s| s.b1), s.map(|s| s.b2));
    let (a1, a2) = (s.map(|s| s.a1), s.map(|s| s.a2));
    let (mut z0, mut z1) = (z.map(|z| z[0]), z.map(|z| z[1]));
    for n in lag..x.len() {
        let mut input = [x[n]; N];
        input[1..].copy_from_slice(&last[..lag]);
        let mut y = [0.0; N];
        // The same operations as in `advance`, written out over arrays: so the compiler packs all `N` of them.
        for i in 0..N {
            y[i] = b0[i] * input[i] + z0[i];
            z0[i] = b1[i] * input[i] - a1[i] * y[i] + z1[i];
            z1[i] = b2[i] * input[i] - a2[i] * y[i];
        }
        x[n - lag] = y[lag];
        last = y;
    }
    for (i, z) in z.iter_mut().enumerate() {
        *z = [z0[i], z1[i]];
    }
    last
}

/// Filters rows of `channels` values in place; `state` holds `z0` of every channel, then `z1`, per section.
///
/// Neighbouring channels advance together and hide each other's latency.
pub(crate) fn many_channels(sections: &[Section], state: &mut [f64], channels: usize, rows: &mut [f64]) {
    for first in (0..channels).step_by(8) {
        match channels - first {
            1 => lanes::<1>(sections, state, channels, first, rows),
            2 => lanes::<2>(sections, state, channels, first, rows),
            3 => lanes::<3>(sections, state, channels, first, rows),
            4 => lanes::<4>(sections, state, channels, first, rows),
            5 => lanes::<5>(sections, state, channels, first, rows),
            6 => lanes::<6>(sections, state, channels, first, rows),
            7 => lanes::<7>(sections, state, channels, first, rows),
            _ => lanes::<8>(sections, state, channels, first, rows),
        }
    }
}

/// Filters the `L` channels that begin at `first`.
fn lanes<const L: usize>(
    sections: &[Section],
    state: &mut [f64],
    channels: usize,
    first: usize,
    rows: &mut [f64],
) {
    for stretch in rows.chunks_mut(channels * (STRETCH / L)) {
        for (s, z) in sections.iter().zip(state.chunks_exact_mut(2 * channels)) {
            let (z0, z1) = z.split_at_mut(channels);
            let (Some(z0), Some(z1)) =
                (z0[first..].first_chunk_mut::<L>(), z1[first..].first_chunk_mut::<L>())
            else {
                return;
            };
            let (mut w0, mut w1) = (*z0, *z1);
            for row in stretch.chunks_exact_mut(channels) {
                if let Some(x) = row[first..].first_chunk_mut::<L>() {
                    for i in 0..L {
                        (x[i], [w0[i], w1[i]]) = advance(s, [w0[i], w1[i]], x[i]);
                    }
                }
            }
            (*z0, *z1) = (w0, w1);
        }
    }
}
