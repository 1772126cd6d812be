//! Counters of 32 bits that wrap, made into 64 bits that do not.

/// A counter's value in 64 bits, and how it relates to those before.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Widened {
    /// At or after the largest so far; equal to it when the same value came again.
    Onward(u64),
    /// Before the largest so far by no more than packets get out of order. `None` if it also comes before the zero from
    /// which the 64 bits count: a packet from before a wrap that came after the very first one.
    Earlier(Option<u64>),
    /// So far back that the device must have started again: a new count begins, at the counter's own value.
    Restarted(u64),
}

/// Widens one wrapping counter.
///
/// ```
/// use granular_id::buffer::{Widened, Widener};
///
/// let mut counter = Widener::new(1000);
/// assert_eq!(counter.widen(u32::MAX), Widened::Onward(4_294_967_295));
/// assert_eq!(counter.widen(1), Widened::Onward(4_294_967_297));
/// assert_eq!(counter.widen(0), Widened::Earlier(Some(4_294_967_296)));
/// assert_eq!(counter.widen(3_000_000_000), Widened::Restarted(3_000_000_000));
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Widener {
    largest: Option<u64>,
    max_back: u32,
}

impl Widener {
    /// A widener that takes up to `max_back` steps back for packets out of order, and more for a restart.
    ///
    /// Steps forward reach up to half the counter's range; `max_back` is cut to that.
    #[must_use]
    pub fn new(max_back: u32) -> Self {
        Self { largest: None, max_back: max_back.min(1 << 31) }
    }

    /// The next value of the counter as it came.
    pub fn widen(&mut self, counter: u32) -> Widened {
        let Some(largest) = self.largest else {
            self.largest = Some(u64::from(counter));
            return Widened::Onward(u64::from(counter));
        };
        // The low half is the counter's own value.
        #[allow(clippy::cast_possible_truncation)]
        let low = largest as u32;
        let forward = counter.wrapping_sub(low);
        let back = low.wrapping_sub(counter);
        if forward < 1 << 31 {
            let wide = largest.saturating_add(u64::from(forward));
            self.largest = Some(wide);
            Widened::Onward(wide)
        } else if back <= self.max_back {
            Widened::Earlier(largest.checked_sub(u64::from(back)))
        } else {
            self.largest = Some(u64::from(counter));
            Widened::Restarted(u64::from(counter))
        }
    }

    /// Forgets everything: the next value is the first.
    pub fn reset(&mut self) {
        self.largest = None;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn a_wrap_goes_on() {
        let mut widener = Widener::new(0);
        for wide in (1_u64 << 32) - 3..(1 << 32) + 3 {
            #[allow(clippy::cast_possible_truncation)]
            let counter = wide as u32;
            assert_eq!(widener.widen(counter), Widened::Onward(wide));
            assert_eq!(widener.widen(counter), Widened::Onward(wide), "the same value again");
        }
    }

    #[test]
    fn two_wraps_are_two() {
        let mut widener = Widener::new(0);
        for (counter, wide) in
            [(0, 0), (1 << 30, 1 << 30), (1 << 31, 1 << 31), (3 << 30, 3 << 30), (0, 1 << 32)]
        {
            assert_eq!(widener.widen(counter), Widened::Onward(wide));
        }
        assert_eq!(widener.widen(1 << 30), Widened::Onward((1 << 32) + (1 << 30)));
    }

    #[test]
    fn the_bound_between_late_and_restarted_is_exact() {
        let mut widener = Widener::new(10);
        widener.widen(100);
        assert_eq!(widener.widen(90), Widened::Earlier(Some(90)));
        assert_eq!(widener.widen(101), Widened::Onward(101), "an earlier one moves nothing");
        assert_eq!(widener.widen(90), Widened::Restarted(90));
        assert_eq!(widener.widen(91), Widened::Onward(91));
    }

    #[test]
    fn before_the_first_zero_there_is_no_number() {
        let mut widener = Widener::new(10);
        widener.widen(2);
        assert_eq!(widener.widen(u32::MAX - 1), Widened::Earlier(None));
        assert_eq!(widener.widen(3), Widened::Onward(3));
        widener.reset();
        assert_eq!(widener.widen(u32::MAX - 1), Widened::Onward(u64::from(u32::MAX - 1)));
    }

    #[test]
    fn a_step_of_half_the_range_is_back_at_most() {
        let mut widener = Widener::new(u32::MAX);
        widener.widen(0);
        assert_eq!(widener.widen((1 << 31) - 1), Widened::Onward((1 << 31) - 1));
        assert_eq!(widener.widen(u32::MAX), Widened::Earlier(None));
    }

    proptest! {
        /// Any walk with steps below half the range forward and up to `max_back` back is followed exactly.
        #[test]
        fn follows_a_walk(start in any::<u32>(), steps in prop::collection::vec((any::<bool>(), 0..1_u32 << 31), 1..200)) {
            let max_back = 5000;
            let mut widener = Widener::new(max_back);
            let mut largest = u64::from(start);
            prop_assert_eq!(widener.widen(start), Widened::Onward(largest));
            for (back, step) in steps {
                let low = largest.to_le_bytes();
                let low = u32::from_le_bytes([low[0], low[1], low[2], low[3]]);
                if back {
                    let step = 1 + step % max_back;
                    let wanted = Widened::Earlier(largest.checked_sub(u64::from(step)));
                    prop_assert_eq!(widener.widen(low.wrapping_sub(step)), wanted);
                } else {
                    largest += u64::from(step);
                    prop_assert_eq!(widener.widen(low.wrapping_add(step)), Widened::Onward(largest));
                }
            }
        }
    }
}
