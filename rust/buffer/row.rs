//! One row of a buffer, and the words that hold it in a slot.

/// One measurement with its two time stamps.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Row {
    /// Device time, never wrapped; the unit is `1 / tick_hz` seconds.
    pub ticks: u64,
    /// When it arrived, by [`host_ns`](super::host_ns).
    pub host_ns: u64,
    /// Forces in N, then torques in N m, in the order of [`AXES`](crate::wrench::AXES).
    pub wrench: [f64; 6],
    /// Bits of [`SAMPLE_FLAGS`](crate::wrench::SAMPLE_FLAGS).
    pub flags: u8,
}

/// A row as a reader gets it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BufferedRow {
    /// What was pushed.
    pub row: Row,
    /// Instants without a row between this one and the one before it in its epoch; `u32::MAX` stands for that many or
    /// more.
    pub missing_before: u32,
    /// Number of its epoch. Rows of two epochs have no common time axis.
    pub epoch: u32,
}

/// Words of a row in a slot.
pub(super) const WORDS: usize = 10;

/// Packet numbers are compared by as many bits as a slot has room for beside the flags.
const PACKET_BITS: u32 = 56;

/// A packet's number in the bits that are kept, or none: all ones.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Packet(u64);

impl Packet {
    pub(super) const UNKNOWN: Self = Self((1 << PACKET_BITS) - 1);

    pub(super) fn new(number: u64) -> Self {
        Self(number & Self::UNKNOWN.0)
    }

    /// True for two known numbers that differ: not one packet twice.
    pub(super) fn differs(self, other: Self) -> bool {
        self != other && self != Self::UNKNOWN && other != Self::UNKNOWN
    }
}

impl BufferedRow {
    /// A row of any content, to be overwritten: room for [`Reader::read`](super::Reader::read).
    pub const EMPTY: Self =
        Self { row: Row { ticks: 0, host_ns: 0, wrench: [0.0; 6], flags: 0 }, missing_before: 0, epoch: 0 };

    pub(super) fn to_words(self, packet: Packet) -> [u64; WORDS] {
        let [fx, fy, fz, tx, ty, tz] = self.row.wrench.map(f64::to_bits);
        let place = u64::from(self.epoch) << 32 | u64::from(self.missing_before);
        let marks = u64::from(self.row.flags) << PACKET_BITS | packet.0;
        [self.row.ticks, self.row.host_ns, fx, fy, fz, tx, ty, tz, place, marks]
    }

    pub(super) fn from_words(words: &[u64; WORDS]) -> (Self, Packet) {
        let [ticks, host_ns, wrench @ .., place, marks] = *words;
        let [missing_before, epoch] = halves(place);
        let [.., flags] = marks.to_le_bytes();
        let row = Row { ticks, host_ns, wrench: wrench.map(f64::from_bits), flags };
        (Self { row, missing_before, epoch }, Packet::new(marks))
    }
}

/// The low and the high half of a word.
fn halves(word: u64) -> [u32; 2] {
    let [a, b, c, d, e, f, g, h] = word.to_le_bytes();
    [u32::from_le_bytes([a, b, c, d]), u32::from_le_bytes([e, f, g, h])]
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn words_give_the_row_back(
            (ticks, host_ns, flags, missing_before, epoch, packet) in any::<(u64, u64, u8, u32, u32, u64)>(),
            wrench in proptest::array::uniform6(proptest::num::f64::NORMAL),
        ) {
            let row = BufferedRow { row: Row { ticks, host_ns, wrench, flags }, missing_before, epoch };
            let packet = Packet::new(packet);
            prop_assert_eq!(BufferedRow::from_words(&row.to_words(packet)), (row, packet));
        }
    }

    #[test]
    fn only_known_packets_differ() {
        let [one, two] = [1, 2].map(Packet::new);
        assert!(one.differs(two));
        assert!(!one.differs(one));
        assert!(!one.differs(Packet::UNKNOWN));
        assert!(!Packet::UNKNOWN.differs(one));
    }
}
