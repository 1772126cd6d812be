//! A histogram with bins of nearly equal ratio, found in the bits of a number.
//!
//! The exponent and the first four bits of the mantissa of a float64 say in which sixteenth of which octave it lies, so no
//! logarithm and no search is needed.

/// Bins of each octave: equal steps, as the first four bits of a mantissa make them.
const PER_OCTAVE: i16 = 16;

/// The octaves: from two to this power, to two to that power.
const LOWEST: i16 = -6;
const HIGHEST: i16 = 8;

/// The bin around zero, which is also the number of bins on either side.
const MIDDLE: i16 = (HIGHEST - LOWEST) * PER_OCTAVE;

/// All bins.
pub(super) const N_BINS: usize = 2 * MIDDLE as usize + 1;

/// The bits that choose the bin: sign, exponent and the first four of the mantissa.
const BITS: u32 = 16;

/// Those of numbers just below the first octave, and of numbers in the last bin.
const BELOW: i16 = (1023 + LOWEST) * PER_OCTAVE - 1;
const LAST: i16 = (1023 + HIGHEST) * PER_OCTAVE - 1;

/// The bits that choose the bin of a number.
#[allow(clippy::cast_possible_truncation)] // those that are left
#[inline(always)]
pub(super) fn word(z: f64) -> i16 {
    ((z.to_bits() >> (u64::BITS - BITS)) as u16).cast_signed()
}

/// The bin of a number with these bits; those beyond the outermost bins count there.
#[inline(always)]
pub(super) fn bin(word: i16) -> u16 {
    let outward = (word & i16::MAX).clamp(BELOW, LAST) - BELOW;
    let sign = word >> (BITS - 1);
    (MIDDLE + ((outward ^ sign) - sign)).cast_unsigned()
}

/// The edges of all bins, ascending: bin `b` lies between edges `b` and `b + 1`.
pub(super) fn edges() -> Vec<f64> {
    let outward = |k: i16| {
        let octave = f64::from(LOWEST + k / PER_OCTAVE);
        libm::exp2(octave) * (1.0 + f64::from(k % PER_OCTAVE) / f64::from(PER_OCTAVE))
    };
    let right = (0..=MIDDLE).map(outward);
    let left = (0..=MIDDLE).rev().map(|k| -outward(k));
    left.chain(right).collect()
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const MIDDLE: usize = super::MIDDLE as usize;

    fn bin_of(z: f64) -> usize {
        bin(word(z)).into()
    }

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
            assert_eq!(bin_of(*edge), b);
            assert_eq!(bin_of(edge.next_down()), b - 1);
            assert_eq!(bin_of(-edge), 2 * MIDDLE - b);
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
        ] {
            assert_eq!(bin_of(z), expected, "{z}");
        }
    }

    proptest! {
        #[test]
        fn a_number_lies_in_its_bin(z in -255.0..255.0) {
            let edges = edges();
            prop_assert!(edges[bin_of(z)] <= z && z <= edges[bin_of(z) + 1]);
        }
    }
}
