//! A histogram with bins of nearly equal ratio, found in the bits of a number.
//!
//! The exponent and the first four bits of the mantissa of a float64 say in which sixteenth of which octave it lies, so no
//! logarithm and no search is needed.

/// Bins of each octave: equal steps, as the first four bits of a mantissa make them.
const PER_OCTAVE: usize = 16;

/// The octaves: from two to this power, to two to that power.
const LOWEST: i32 = -6;
const HIGHEST: i32 = 8;

/// The bin around zero, which is also the number of bins on either side.
const MIDDLE: usize = (HIGHEST - LOWEST) as usize * PER_OCTAVE;

/// All bins.
pub(super) const N_BINS: usize = 2 * MIDDLE + 1;

/// Bits below those that choose the bin.
const SHIFT: u32 = 48;

/// The bits that choose the bin, of the numbers just below the first octave.
const BELOW: i64 = ((1023 + LOWEST as i64) << 4) - 1;

/// A number just below the first octave, and one in the last bin.
const LEAST: f64 = 0.015_5;
const MOST: f64 = 255.0;

/// The bin of a number; those beyond the outermost bins count there.
#[allow(clippy::cast_possible_truncation, clippy::cast_possible_wrap, clippy::cast_sign_loss)] // 0 to N_BINS
#[inline(always)]
pub(super) fn bin(z: f64) -> usize {
    let size = z.abs();
    // One instruction each; NaN goes to the middle.
    let size = if size > LEAST { size } else { LEAST };
    let size = if size < MOST { size } else { MOST };
    let outward = (size.to_bits() >> SHIFT).cast_signed() - BELOW;
    let sign = z.to_bits().cast_signed() >> 63;
    (MIDDLE as i64 + ((outward ^ sign) - sign)) as usize
}

/// True for a number that may lie in another bin if it is off by two units in the last place.
#[inline(always)]
pub(super) fn near_edge(z: f64) -> bool {
    const FRACTION: u64 = (1 << SHIFT) - 1;
    // Eight numbers about each edge, those with bits -4 to 3.
    (z.to_bits().wrapping_add(4)) & (FRACTION - 7) == 0
}

/// The edges of all bins, ascending: bin `b` lies between edges `b` and `b + 1`.
pub(super) fn edges() -> Vec<f64> {
    let outward = |k: usize| {
        let octave = f64::from(LOWEST) + (k / PER_OCTAVE) as f64;
        octave.exp2() * (1.0 + (k % PER_OCTAVE) as f64 / PER_OCTAVE as f64)
    };
    let right = (0..=MIDDLE).map(outward);
    let left = (0..=MIDDLE).rev().map(|k| -outward(k));
    left.chain(right).collect()
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn edges_ascend_from_end_to_end() {
        let edges = edges();
        assert_eq!(edges.len(), N_BINS + 1);
        assert!(edges.is_sorted_by(|a, b| a < b));
        assert_eq!((edges[0], edges[N_BINS]), (-256.0, 256.0));
        assert_eq!(edges[MIDDLE..MIDDLE + 2], [-1.0 / 64.0, 1.0 / 64.0]);
    }

    #[test]
    fn an_edge_belongs_to_the_outer_bin() {
        let edges = edges();
        for (b, edge) in edges.iter().enumerate().take(N_BINS).skip(MIDDLE + 1) {
            assert_eq!(bin(*edge), b);
            assert_eq!(bin(edge.next_down()), b - 1);
            assert_eq!(bin(-edge), 2 * MIDDLE - b);
            assert!(near_edge(*edge) && near_edge(edge.next_down()));
            assert!(!near_edge(edge * (1.0 + 1e-12)));
        }
    }

    #[test]
    fn the_ends() {
        for (z, expected) in [
            (0.0, MIDDLE),
            (-0.0, MIDDLE),
            (5e-324, MIDDLE),
            (-1e-3, MIDDLE),
            (255.9, N_BINS - 1),
            (256.0, N_BINS - 1),
            (f64::INFINITY, N_BINS - 1),
            (-f64::MAX, 0),
            (f64::NAN, MIDDLE),
        ] {
            assert_eq!(bin(z), expected, "{z}");
        }
    }

    proptest! {
        #[test]
        fn a_number_lies_in_its_bin(z in -255.0..255.0) {
            let edges = edges();
            prop_assert!(edges[bin(z)] <= z && z <= edges[bin(z) + 1]);
        }
    }
}
