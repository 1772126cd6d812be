//! Natural logarithms and inverse hyperbolic sines of numbers, a few side by side.

use crate::kernel::Pack;

const LN2_HIGH: f64 = 0.693_147_180_369_123_8;
const LN2_LOW: f64 = 1.908_214_929_270_587_7e-10;
const EVEN: [f64; 3] = [0.399_999_999_994_094_2, 0.222_221_984_321_497_84, 0.153_138_376_992_093_73];
const ODD: [f64; 4] =
    [0.666_666_666_666_673_5, 0.285_714_287_436_623_9, 0.181_835_721_616_180_5, 0.147_981_986_051_165_86];

/// Bits of the square root of one half, of which only the high word counts.
const ROOT_HALF: u64 = 0x3fe6_a09e << 32;

/// Bits of 2^52: a small integer in the low bits makes it 2^52 plus this integer.
const MAGIC: u64 = 0x4330_0000_0000_0000;

/// Bits of one.
const ONE: u64 = 0x3ff << 52;

/// Logarithms with the bits of `libm::log` (fdlibm's `e_log.c`, Sun Microsystems 1993): the same steps for all lanes, and
/// `libm::log` itself where one of them is not a positive normal number.
#[inline(always)]
pub(super) fn log<const L: usize>(x: Pack<f64, L>) -> Pack<f64, L> {
    // As integers: numbers below the smallest normal one, or above the largest finite one, leave a sign somewhere.
    let [least, most] = [f64::MIN_POSITIVE, f64::MAX].map(|end| end.to_bits().cast_signed());
    let mut outside = 0;
    for l in 0..L {
        let bits = x.0[l].to_bits().cast_signed();
        outside |= bits | bits.wrapping_sub(least) | most.wrapping_sub(bits);
    }
    if outside < 0 {
        return one_by_one(x);
    }
    // x = 2^k (1 + f) with 1 + f between the root of one half and the root of two.
    let (mut k, mut f) = (Pack::ZERO, Pack::ZERO);
    for l in 0..L {
        let above = x.0[l].to_bits() + (ONE - ROOT_HALF);
        k.0[l] = f64::from_bits(MAGIC | above >> 52) - (4_503_599_627_370_496.0 + 1_023.0);
        f.0[l] = f64::from_bits((above & 0x000f_ffff_ffff_ffff) + ROOT_HALF) - 1.0;
    }
    let of = Pack::splat;
    let half_square = of(0.5) * f * f;
    let s = f / (of(2.0) + f);
    let z = s * s;
    let w = z * z;
    let even = w * (of(EVEN[0]) + w * (of(EVEN[1]) + w * of(EVEN[2])));
    let odd = z * (of(ODD[0]) + w * (of(ODD[1]) + w * (of(ODD[2]) + w * of(ODD[3]))));
    s * (half_square + (odd + even)) + k * of(LN2_LOW) - half_square + f + k * of(LN2_HIGH)
}

/// Any numbers. Never inlined: else a compiler calculates both ways for all numbers and then takes one.
#[cold]
#[inline(never)]
fn one_by_one<const L: usize>(x: Pack<f64, L>) -> Pack<f64, L> {
    let mut out = x;
    for l in 0..L {
        out.0[l] = libm::log(x.0[l]);
    }
    out
}

/// Inverse hyperbolic sines of numbers whose squares are finite.
#[inline(always)]
pub(super) fn asinh<const L: usize>(x: Pack<f64, L>) -> Pack<f64, L> {
    let size = x.abs();
    let square = size * size;
    // The sum of the logarithm's argument and what rounding has taken from it (Kahan's `log1p`).
    let more = size + square / ((square + Pack::ONE).sqrt() + Pack::ONE);
    let sum = more + Pack::ONE;
    let lost = (more - (sum - Pack::ONE)) / sum;
    (log(sum) + lost).with_sign_of(x)
}

/// Something done to numbers side by side. A trait, because a function that is passed on as a value loses the vector
/// features of its caller.
pub(super) trait Function {
    fn of<const L: usize>(x: Pack<f64, L>) -> Pack<f64, L>;
}

/// [`log`].
pub(super) struct Log;

impl Function for Log {
    #[inline(always)]
    fn of<const L: usize>(x: Pack<f64, L>) -> Pack<f64, L> {
        log(x)
    }
}

/// [`asinh`].
pub(super) struct Asinh;

impl Function for Asinh {
    #[inline(always)]
    fn of<const L: usize>(x: Pack<f64, L>) -> Pack<f64, L> {
        asinh(x)
    }
}

/// Replaces numbers by a function of them, `L` at a time.
#[inline(always)]
pub(super) fn each<F: Function, const L: usize>(values: &mut [f64]) {
    let mut whole = values.chunks_exact_mut(L);
    for chunk in &mut whole {
        chunk.copy_from_slice(&F::of::<L>(Pack::load(chunk)).0);
    }
    let rest = whole.into_remainder();
    if !rest.is_empty() {
        let mut last = Pack::<f64, L>::ONE;
        last.0[..rest.len()].copy_from_slice(rest);
        let last = F::of(last);
        rest.copy_from_slice(&last.0[..rest.len()]);
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn any_number_has_the_bits_of_libm(bits in any::<[u64; 4]>()) {
            let x = bits.map(f64::from_bits);
            let got = log(Pack(x)).0.map(f64::to_bits);
            prop_assert_eq!(got, x.map(|x| libm::log(x).to_bits()));
        }

        #[test]
        fn positive_numbers_have_the_bits_of_libm(x in prop::array::uniform4(1e-9..1e9)) {
            prop_assert_eq!(log(Pack(x)).0, x.map(libm::log));
        }

        #[test]
        fn inverse_sines_are_those_of_libm(x in prop::array::uniform4(-300.0..300.0), power in -60..0) {
            let x = x.map(|x| x * f64::from(power).exp2());
            for (got, x) in asinh(Pack(x)).0.into_iter().zip(x) {
                prop_assert!((got - libm::asinh(x)).abs() <= 4e-16 * got.abs(), "asinh({x}) = {got}");
            }
        }
    }

    #[test]
    fn edges() {
        let x = [f64::MIN_POSITIVE, 1.0, f64::MAX, std::f64::consts::SQRT_2, std::f64::consts::FRAC_1_SQRT_2];
        assert_eq!(log(Pack(x)).0, x.map(libm::log));
        assert_eq!(asinh(Pack([0.0, -0.0])).0.map(f64::to_bits), [0.0, -0.0].map(f64::to_bits));
    }

    #[test]
    fn all_of_a_slice() {
        let mut values: Vec<f64> = (1..=11).map(f64::from).collect();
        let expected: Vec<f64> = values.iter().map(|x| libm::log(*x)).collect();
        each::<Log, 4>(&mut values);
        assert_eq!(values, expected);
    }
}
