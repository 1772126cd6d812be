//! Natural logarithms: of numbers, and of symmetric matrices, a few side by side.
//!
//! A matrix is made tridiagonal by Householder reflections, diagonal by QL iterations (Bowdler, Martin, Reinsch, Wilkinson,
//! "The QR and QL algorithms for symmetric matrices", 1968), and put together again with the logarithms of its
//! eigenvalues. All lanes take the same steps; one that has converged stands still, so that no matrix changes the bits
//! of another.

use crate::kernel::{Pack, Register, Vectors};

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

/// Matrices at a time: eight bands of a recording of 1600 samples have one.
pub(super) const MATRICES: usize = 8;

/// Below this a sum of squares counts as zero, for matrices with a trace of about one: far below rounding, and far from
/// where a reciprocal overflows.
const NOTHING: f64 = 1e-290;

/// QL iterations for one eigenvalue at most; two or three do.
const MAX_ITERATIONS: usize = 60;

/// Lanes of a register, and registers for all matrices.
const LANES: usize = 4;
pub(super) const REGISTERS: usize = MATRICES / LANES;

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

/// One number of each matrix.
pub(super) type Numbers = Pack<f64, MATRICES>;

/// Room for the logarithms of some matrices of `n` rows.
#[derive(Clone, Debug)]
pub(super) struct Logarithms {
    n: usize,
    /// The matrices, row by row; of them only the lower triangles count.
    pub(super) matrices: Vec<Numbers>,
    /// Eigenvectors in the making, column by column.
    vectors: Vec<Numbers>,
    diagonal: Vec<Numbers>,
    below: Vec<Numbers>,
    factors: Vec<Numbers>,
    temporary: Vec<Numbers>,
}

impl Logarithms {
    pub(super) fn new(n: usize) -> Self {
        let zeros = |len| vec![Pack::ZERO; len];
        Self {
            n,
            matrices: zeros(n * n),
            vectors: zeros(n * n),
            diagonal: zeros(n),
            below: zeros(n),
            factors: zeros(n),
            temporary: zeros(n),
        }
    }

    /// Replaces the lower triangle of each matrix by that of its logarithm; eigenvalues below `floor` count as `floor`.
    /// NaN throughout for a matrix of which the trace is not finite.
    #[inline(always)]
    pub(super) fn take(&mut self, simd: impl Vectors<f64, 4>, floor: f64) {
        let n = self.n;
        let shrink = self.shrink();
        let Self { matrices, vectors, diagonal, below, factors, temporary, .. } = self;
        tridiagonal(matrices, diagonal, below, factors, temporary);
        product(matrices, factors, vectors);
        diagonalise(simd, diagonal, below, vectors);
        for (value, scaled) in self.diagonal.iter().zip(&mut self.temporary) {
            let value = *value / shrink;
            let floor = Pack::splat(floor);
            // NaN is not above anything: it has to be put back.
            *scaled = log(value.above(floor).select(value, floor)) + shrink * Pack::ZERO;
        }
        for j in 0..n {
            for (k, scaled) in self.factors.iter_mut().enumerate() {
                *scaled = self.vectors[k * n + j] * self.temporary[k];
            }
            for i in j..n {
                let row = self.vectors[i..].iter().step_by(n);
                let products = row.zip(&self.factors).map(|(a, b)| *a * *b);
                self.matrices[i * n + j] = products.fold(Pack::ZERO, |sum, product| sum + product);
            }
        }
    }

    /// Multiplies each matrix by a power of two that brings its trace to between one and four, and returns these; NaN
    /// where the trace is not finite.
    #[inline(always)]
    fn shrink(&mut self) -> Numbers {
        let n = self.n;
        let trace = (0..n).fold(Pack::ZERO, |sum, i| sum + self.matrices[i * n + i]);
        let mut shrink = Pack::ZERO;
        for l in 0..MATRICES {
            let exponent = trace.0[l].to_bits() >> 52 & 0x7ff;
            let power = f64::from_bits((2046_u64.saturating_sub(exponent)).max(1) << 52);
            shrink.0[l] = if trace.0[l].is_finite() { power } else { f64::NAN };
        }
        for value in &mut self.matrices {
            *value = *value * shrink;
        }
        shrink
    }
}

/// `n - 2` reflections of matrices `a`, of which the lower triangles count, leave a diagonal `d` and `e` below it. Each
/// reflection `1 - factor v v'` stays in the column of `a` that it has cleared; `p` is room for `n` numbers.
#[inline(always)]
fn tridiagonal(
    a: &mut [Numbers],
    d: &mut [Numbers],
    e: &mut [Numbers],
    factors: &mut [Numbers],
    p: &mut [Numbers],
) {
    let n = d.len();
    for k in 0..n {
        d[k] = a[k * n + k];
        if k + 2 >= n {
            factors[k] = Pack::ZERO;
            e[k] = if k + 1 < n { a[(k + 1) * n + k] } else { Pack::ZERO };
            continue;
        }
        let rest = (k + 2..n).fold(Pack::ZERO, |sum, i| sum + a[i * n + k] * a[i * n + k]);
        let head = a[(k + 1) * n + k];
        let square = head * head + rest;
        let length = square.sqrt();
        let needed = rest.above(Pack::splat(NOTHING));
        let factor = needed.select(Pack::ONE / (square + head.abs() * length), Pack::ZERO);
        factors[k] = factor;
        e[k] = needed.select(-length.with_sign_of(head), head);
        a[(k + 1) * n + k] = head + length.with_sign_of(head);
        // p = factor A v, then w = p - factor / 2 (p'v) v, then A -= v w' + w v'.
        for i in k + 1..n {
            let v_i = a[i * n + k];
            let mut sum = a[i * n + i] * v_i;
            for j in k + 1..i {
                let a_ij = a[i * n + j];
                sum = sum + a_ij * a[j * n + k];
                p[j] = p[j] + a_ij * v_i;
            }
            p[i] = sum;
        }
        let mut dot = Pack::ZERO;
        for i in k + 1..n {
            p[i] = p[i] * factor;
            dot = dot + p[i] * a[i * n + k];
        }
        let half = Pack::splat(0.5) * factor * dot;
        for i in k + 1..n {
            p[i] = p[i] - half * a[i * n + k];
        }
        for i in k + 1..n {
            let (v_i, w_i) = (a[i * n + k], p[i]);
            for j in k + 1..=i {
                a[i * n + j] = a[i * n + j] - (v_i * p[j] + w_i * a[j * n + k]);
            }
        }
    }
}

/// The product of all reflections that [`tridiagonal`] has left, column by column.
#[inline(always)]
fn product(a: &[Numbers], factors: &[Numbers], q: &mut [Numbers]) {
    let n = factors.len();
    q.fill(Pack::ZERO);
    for i in 0..n {
        q[i * n + i] = Pack::ONE;
    }
    for k in (0..n.saturating_sub(2)).rev() {
        let v = |i: usize| a[i * n + k];
        for column in q.chunks_exact_mut(n).skip(k + 1) {
            let products = (k + 1..n).map(|i| v(i) * factors[k] * column[i]);
            let sum = products.fold(Pack::ZERO, |sum, product| sum + product);
            for (i, x) in column.iter_mut().enumerate().skip(k + 1) {
                *x = *x - v(i) * sum;
            }
        }
    }
}

/// QL iterations until nothing is left of `e`, below the diagonal `d`; columns of `vectors` are turned along.
#[inline(always)]
fn diagonalise(simd: impl Vectors<f64, 4>, d: &mut [Numbers], e: &mut [Numbers], vectors: &mut [Numbers]) {
    let n = d.len();
    let size = d.iter().zip(&*e).fold(Pack::ZERO, |sum, (d, e)| sum + d.abs() + e.abs());
    let limit = Pack::splat(f64::EPSILON) * size;
    for first in 0..n.saturating_sub(1) {
        for _ in 0..MAX_ITERATIONS {
            let active = e[first].abs().above(limit);
            if !active.any() {
                break;
            }
            iterate(simd, first, active, d, e, vectors);
        }
    }
}

/// One QL iteration on rows `first..n` of the active lanes; other lanes are not turned. Each rotation is done to the
/// vectors at once: their arithmetic fills the time in which the next one waits for a root and a quotient.
#[inline(always)]
fn iterate<S: Vectors<f64, 4>>(
    simd: S,
    first: usize,
    active: Numbers,
    d: &mut [Numbers],
    e: &mut [Numbers],
    vectors: &mut [Numbers],
) {
    let n = d.len();
    // The eigenvalue of the first two rows that is nearer to the first.
    let half = Pack::splat(0.5) * (d[first + 1] - d[first]);
    let root = (half * half + e[first] * e[first]).sqrt();
    let shift = d[first] - e[first] * e[first] / (half + root.with_sign_of(half));
    let (zero, one) = (simd.splat(0.0), simd.splat(1.0));
    let (mut c, mut s) = ([one; REGISTERS], [zero; REGISTERS]);
    let mut p = [zero; REGISTERS];
    let (mut d_after, mut e_after) = (p, p);
    for k in 0..REGISTERS {
        (d_after[k], e_after[k]) = (load(simd, &d[n - 1], k), load(simd, &e[n - 1], k));
        p[k] = d_after[k] - load(simd, &shift, k);
    }
    for i in (first..n - 1).rev() {
        let (mut cosine, mut sine) = (c, s);
        for k in 0..REGISTERS {
            let (active, shift) = (load(simd, &active, k), load(simd, &shift, k));
            let (d_i, e_i) = (load(simd, &d[i], k), load(simd, &e[i], k));
            let (g, h) = (c[k] * e_i, c[k] * p[k]);
            let r = (p[k] * p[k] + e_i * e_i).sqrt();
            store(active.select(s[k] * r, e_after[k]), &mut e[i + 1], k);
            let turned = r.above(zero);
            let inverse = one / r;
            s[k] = turned.select(e_i * inverse, zero);
            c[k] = turned.select(p[k] * inverse, one);
            (cosine[k], sine[k]) = (active.select(c[k], one), active.select(s[k], zero));
            let centred = d_i - shift;
            p[k] = c[k] * centred - s[k] * g;
            let value = h + s[k] * (c[k] * g + s[k] * centred) + shift;
            store(active.select(value, d_after[k]), &mut d[i + 1], k);
            (d_after[k], e_after[k]) = (d_i, e_i);
        }
        turn(simd, &mut vectors[i * n..][..2 * n], cosine, sine);
    }
    for k in 0..REGISTERS {
        let active = load(simd, &active, k);
        store(active.select(s[k] * p[k], e_after[k]), &mut e[first], k);
        store(active.select(c[k] * p[k] + load(simd, &shift, k), d_after[k]), &mut d[first], k);
    }
    e[n - 1] = Pack::ZERO;
}

/// Turns two columns by an angle with some cosine and sine.
#[inline(always)]
fn turn<S: Vectors<f64, 4>>(
    simd: S,
    columns: &mut [Numbers],
    c: [S::Register; REGISTERS],
    s: [S::Register; REGISTERS],
) {
    let (left, right) = columns.split_at_mut(columns.len() / 2);
    for (left, right) in left.iter_mut().zip(right) {
        for k in 0..REGISTERS {
            let (x, y) = (load(simd, left, k), load(simd, right, k));
            store(c[k] * x - s[k] * y, left, k);
            store(s[k] * x + c[k] * y, right, k);
        }
    }
}

/// Those numbers that make up register `k`.
#[inline(always)]
pub(super) fn load<S: Vectors<f64, 4>>(simd: S, numbers: &Numbers, k: usize) -> S::Register {
    simd.load(&numbers.0[k * LANES..])
}

#[inline(always)]
pub(super) fn store(register: impl Register<f64, 4>, numbers: &mut Numbers, k: usize) {
    register.store(&mut numbers.0[k * LANES..]);
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::kernel::Portable;

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

    type Matrix = Vec<Vec<f64>>;

    /// A rotation made of many plane ones, by angles that any sequence gives.
    fn rotation(n: usize, angles: &[f64]) -> Matrix {
        let mut q: Matrix = (0..n).map(|i| (0..n).map(|j| f64::from(u8::from(i == j))).collect()).collect();
        let planes = (0..n).flat_map(|i| (0..i).map(move |j| (i, j)));
        for ((i, j), angle) in planes.zip(angles.iter().cycle()) {
            let (s, c) = angle.sin_cos();
            for row in &mut q {
                (row[i], row[j]) = (c * row[i] - s * row[j], s * row[i] + c * row[j]);
            }
        }
        q
    }

    fn compose(q: &Matrix, values: &[f64]) -> Matrix {
        let entry = |i: usize, j: usize| values.iter().enumerate().map(|(k, v)| q[i][k] * v * q[j][k]).sum();
        (0..q.len()).map(|i| (0..q.len()).map(|j| entry(i, j)).collect()).collect()
    }

    fn logarithms<const L: usize>(matrices: &[Matrix; L], floor: f64) -> [Matrix; L] {
        let n = matrices[0].len();
        let mut work = Logarithms::new(n);
        for (l, matrix) in matrices.iter().enumerate() {
            for (i, row) in matrix.iter().enumerate() {
                for (j, value) in row.iter().enumerate() {
                    work.matrices[i * n + j].0[l] = if j <= i { *value } else { f64::NAN };
                }
            }
        }
        work.take(Portable, floor);
        std::array::from_fn(|l| {
            let entry = |i: usize, j: usize| work.matrices[i.max(j) * n + i.min(j)].0[l];
            (0..n).map(|i| (0..n).map(|j| entry(i, j)).collect()).collect()
        })
    }

    fn largest_difference(a: &Matrix, b: &Matrix) -> f64 {
        a.iter().flatten().zip(b.iter().flatten()).fold(0.0, |most, (a, b)| (a - b).abs().max(most))
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(300))]
        #[test]
        fn logarithms_of_known_eigenvalues(
            n in 1_usize..27,
            angles in prop::collection::vec(-3.2..3.2, 1..30),
            spread in 0.0..21.0,
            exponents in prop::collection::vec(0.0..1.0, 26),
        ) {
            // Up to a billion times the least eigenvalue, which is the floor.
            let values: Vec<f64> = exponents[..n].iter().map(|x: &f64| 1e-3 * f64::exp(x * spread)).collect();
            let logs: Vec<f64> = values.iter().map(|v| v.ln()).collect();
            let q = rotation(n, &angles);
            let [got, constant] = logarithms(&[compose(&q, &values), compose(&q, &vec![2.0; n])], 1e-3);
            let rounding = 1e-14 * (f64::exp(spread) + 10.0);
            prop_assert!(largest_difference(&got, &compose(&q, &logs)) < rounding);
            prop_assert!(largest_difference(&constant, &compose(&q, &vec![2.0_f64.ln(); n])) < 1e-13);
        }

        #[test]
        fn neighbours_change_no_bit(angles in prop::collection::vec(-3.2..3.2, 30), n in 2_usize..14) {
            let values: Vec<f64> = (0..n).map(|i| 1e-3 * (i as f64).exp2()).collect();
            let matrix = compose(&rotation(n, &angles), &values);
            let diagonal = compose(&rotation(n, &[0.0]), &values);
            let broken = compose(&rotation(n, &[0.0]), &vec![f64::INFINITY; n]);
            let [alone, _, _] = logarithms(&[matrix.clone(), diagonal.clone(), diagonal.clone()], 1e-3);
            let [_, beside, lost] = logarithms(&[diagonal, matrix, broken], 1e-3);
            prop_assert_eq!(alone, beside);
            prop_assert!(lost.iter().flatten().all(|x| x.is_nan()));
        }
    }

    #[test]
    fn two_by_two() {
        // Eigenvalues 1 and 3.
        let [log] = logarithms(&[vec![vec![2.0, 1.0], vec![1.0, 2.0]]], 1e-3);
        let half = 0.5 * 3.0_f64.ln();
        assert!(largest_difference(&log, &vec![vec![half; 2]; 2]) < 1e-15);
    }

    #[test]
    fn any_size_of_numbers() {
        for size in [1e-150, 1e150, 1e300] {
            let [log] = logarithms(&[vec![vec![2.0 * size, size], vec![size, 2.0 * size]]], 1e-200);
            assert!((log[0][0] - (size.ln() + 0.5 * 3.0_f64.ln())).abs() < 1e-12);
            assert!((log[0][1] - 0.5 * 3.0_f64.ln()).abs() < 1e-12);
        }
        let [log] = logarithms(&[vec![vec![0.0; 3]; 3]], 1e-3);
        assert_eq!(log[0], [1e-3_f64.ln(), 0.0, 0.0]);
    }
}
