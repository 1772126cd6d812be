//! What goes over the wire: records from the box, eight-byte requests to it, and what scale and kind of box make of them.

use super::RdtError;
use crate::specs::choices;
use crate::wrench::{BAD_STATUS, SATURATED};

/// Bytes of a record, big-endian.
pub const RECORD_BYTES: usize = 36;

/// The most records a datagram can hold: forty fill an Ethernet frame.
pub const MAX_RECORDS: usize = 40;

/// One record, still in counts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Record {
    /// Number of the record within the requested stream, from 1; 0 follows 2^32 - 1.
    pub rdt_sequence: u32,
    /// Number of the sample within the sensor, which takes more samples than it sends.
    pub ft_sequence: u32,
    /// Bits of the sensor's condition: see [`Variant`].
    pub status: u32,
    /// Fx, Fy, Fz, Tx, Ty, Tz.
    pub counts: [i32; 6],
}

impl Record {
    /// The record in these bytes.
    #[must_use]
    pub fn from_bytes(bytes: &[u8; RECORD_BYTES]) -> Self {
        let (words, _) = bytes.as_chunks();
        let word = |i: usize| u32::from_be_bytes(words[i]);
        Self {
            rdt_sequence: word(0),
            ft_sequence: word(1),
            status: word(2),
            counts: std::array::from_fn(|i| word(3 + i).cast_signed()),
        }
    }

    /// The bytes of the record.
    #[must_use]
    pub fn to_bytes(self) -> [u8; RECORD_BYTES] {
        let mut bytes = [0; RECORD_BYTES];
        let (words, _) = bytes.as_chunks_mut();
        words[0] = self.rdt_sequence.to_be_bytes();
        words[1] = self.ft_sequence.to_be_bytes();
        words[2] = self.status.to_be_bytes();
        for (word, count) in words[3..].iter_mut().zip(self.counts) {
            *word = count.to_be_bytes();
        }
        bytes
    }
}

/// The records of a datagram; `None` where its length is not that of 1 to 40 records.
///
/// ```
/// use granular_id::rdt::records;
///
/// assert_eq!(records(&[0; 72]).map(Iterator::count), Some(2));
/// assert!(records(&[0; 35]).is_none());
/// ```
#[must_use]
pub fn records(datagram: &[u8]) -> Option<impl Iterator<Item = Record> + '_> {
    let (whole, rest) = datagram.as_chunks();
    let fits = rest.is_empty() && (1..=MAX_RECORDS).contains(&whole.len());
    fits.then(|| whole.iter().map(Record::from_bytes))
}

/// First two bytes of every request.
const HEADER: u16 = 0x1234;

/// A request to a box, eight bytes; it never acknowledges.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Request {
    /// End the stream.
    Stop,
    /// Records without end, one per datagram.
    StartRealTime,
    /// Records without end, several per datagram.
    StartBuffered,
    /// Make the present load the new zero, for every client of the box.
    Bias,
    /// The same for boxes of `OnRobot`, which want a number with it.
    BiasOnRobot,
    /// Milliseconds between records, for boxes of `OnRobot`.
    PeriodOnRobot {
        /// The period.
        period_ms: u32,
    },
}

impl Request {
    /// The datagram.
    ///
    /// ```
    /// use granular_id::rdt::Request;
    ///
    /// assert_eq!(Request::StartRealTime.bytes(), [0x12, 0x34, 0, 2, 0, 0, 0, 0]);
    /// ```
    #[must_use]
    pub fn bytes(self) -> [u8; 8] {
        let (command, number): (u16, u32) = match self {
            Self::Stop => (0x0000, 0),
            Self::StartRealTime => (0x0002, 0),
            Self::StartBuffered => (0x0003, 0),
            Self::Bias => (0x0042, 0),
            Self::BiasOnRobot => (0x0042, 255),
            Self::PeriodOnRobot { period_ms } => (0x0082, period_ms),
        };
        let mut bytes = [0; 8];
        bytes[..2].copy_from_slice(&HEADER.to_be_bytes());
        bytes[2..4].copy_from_slice(&command.to_be_bytes());
        bytes[4..].copy_from_slice(&number.to_be_bytes());
        bytes
    }
}

/// Counts per newton that a sensor can have: with fewer, its steps would be coarser than a newton; with more, 32 bits
/// would end at 2 N.
pub const COUNTS_PER_NEWTON: (f64, f64) = (1.0, 1e9);

/// Counts per newton metre: likewise, for lever arms of a millimetre and more.
pub const COUNTS_PER_NEWTON_METRE: (f64, f64) = (1.0, 1e12);

/// Counts per newton and per newton metre, checked.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scale {
    counts_per_newton: f64,
    counts_per_newton_metre: f64,
}

impl Scale {
    /// A scale, unless it is one that no sensor has.
    pub fn new(counts_per_newton: f64, counts_per_newton_metre: f64) -> Result<Self, RdtError> {
        checked("counts_per_newton", counts_per_newton, COUNTS_PER_NEWTON)?;
        checked("counts_per_newton_metre", counts_per_newton_metre, COUNTS_PER_NEWTON_METRE)?;
        Ok(Self { counts_per_newton, counts_per_newton_metre })
    }

    /// Forces in N and torques in N m; each is one division, rounded once.
    ///
    /// ```
    /// # fn main() -> Result<(), granular_id::rdt::RdtError> {
    /// let scale = granular_id::rdt::Scale::new(1e6, 1e6)?;
    /// assert_eq!(scale.wrench([1_500_000, 0, -1, 250_000, 0, 0]), [1.5, 0.0, -1e-6, 0.25, 0.0, 0.0]);
    /// # Ok(())
    /// # }
    /// ```
    #[must_use]
    pub fn wrench(&self, counts: [i32; 6]) -> [f64; 6] {
        let [fx, fy, fz, tx, ty, tz] = counts.map(f64::from);
        let (force, torque) = (self.counts_per_newton, self.counts_per_newton_metre);
        [fx / force, fy / force, fz / force, tx / torque, ty / torque, tz / torque]
    }
}

fn checked(what: &'static str, value: f64, (least, most): (f64, f64)) -> Result<(), RdtError> {
    // Written so that NaN is refused.
    if value >= least && value <= most {
        Ok(())
    } else {
        Err(RdtError::Setting { what, wanted: format!("from {least} to {most:e}"), value })
    }
}

/// "Any error": set together with the bit of its cause.
const ERROR: u32 = 1 << 31;

/// A threshold was exceeded since the latch was reset: set by the user, no fault of the sensor.
const THRESHOLD: u32 = 1 << 16;

/// Net F/T: saturation of a gauge, or an error of the converter.
const NET_FT_SATURATED: u32 = 1 << 17;

/// Axia: gauge out of range, force or torque out of range.
const AXIA_SATURATED: u32 = 1 << 27 | 1 << 30;

/// Axia: what its manual calls an error (temperature, supply, broken gauge, other, calibration) and the two above.
const AXIA_ERRORS: u32 = 1 << 0 | 1 << 1 | 1 << 2 | 1 << 5 | 1 << 7 | 1 << 29 | AXIA_SATURATED;

/// A kind of sensor box.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Variant {
    /// ATI Net F/T.
    NetFt,
    /// ATI Ethernet Axia.
    Axia,
    /// `OnRobot` (`OptoForce`) HEX with its box: the same framing, other requests.
    OnRobot,
}

choices! { Variant: "netft" NetFt, "axia" Axia, "onrobot" OnRobot, }

impl Variant {
    /// Flags of a sample with this status word, as in [`wrench`](crate::wrench), and whether the word is a mere
    /// warning.
    ///
    /// ```
    /// use granular_id::{rdt::Variant, wrench};
    ///
    /// assert_eq!(Variant::NetFt.judge(0), (0, false));
    /// assert_eq!(Variant::NetFt.judge(0x8001_0000), (0, true));
    /// assert_eq!(Variant::NetFt.judge(0x8002_0000), (wrench::BAD_STATUS | wrench::SATURATED, false));
    /// ```
    #[must_use]
    pub fn judge(self, status: u32) -> (u8, bool) {
        // "Any error" with nothing but a threshold as its cause is none.
        let causes = status & !(ERROR | THRESHOLD);
        let error = status & ERROR != 0 && (causes != 0 || status & THRESHOLD == 0);
        let (error, saturated) = match self {
            Self::NetFt => (error, status & NET_FT_SATURATED != 0),
            Self::Axia => (error || status & AXIA_ERRORS != 0, status & AXIA_SATURATED != 0),
            // The meaning of its bits depends on the firmware; 0 is healthy in all of them.
            Self::OnRobot => (status != 0, false),
        };
        let mut flags = 0;
        if error {
            flags |= BAD_STATUS;
        }
        if saturated {
            flags |= SATURATED;
        }
        (flags, status != 0 && flags == 0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    const GOLDEN: [u8; RECORD_BYTES] =
        *b"\x00\x00\x00\x01\x01\x02\x03\x04\x80\x02\x00\x00\x00\x0f\x42\x40\xff\xf0\xbd\xc0\x7f\xff\xff\xff\x80\x00\x00\x00\x00\x00\x00\x00\xff\xff\xff\xff";

    #[test]
    fn a_record_is_these_bytes() {
        let record = Record {
            rdt_sequence: 1,
            ft_sequence: 0x0102_0304,
            status: 0x8002_0000,
            counts: [1_000_000, -1_000_000, i32::MAX, i32::MIN, 0, -1],
        };
        assert_eq!(Record::from_bytes(&GOLDEN), record);
        assert_eq!(record.to_bytes(), GOLDEN);
    }

    #[test]
    fn only_whole_records_are_read() {
        let bytes = [0; 2000];
        let lengths: Vec<usize> = (0..bytes.len()).filter(|n| records(&bytes[..*n]).is_some()).collect();
        assert_eq!(lengths, (1..=40).map(|n| 36 * n).collect::<Vec<_>>());
    }

    #[test]
    fn requests_are_these_bytes() {
        assert_eq!(Request::Stop.bytes(), *b"\x12\x34\x00\x00\x00\x00\x00\x00");
        assert_eq!(Request::StartRealTime.bytes(), *b"\x12\x34\x00\x02\x00\x00\x00\x00");
        assert_eq!(Request::StartBuffered.bytes(), *b"\x12\x34\x00\x03\x00\x00\x00\x00");
        assert_eq!(Request::Bias.bytes(), *b"\x12\x34\x00\x42\x00\x00\x00\x00");
        assert_eq!(Request::BiasOnRobot.bytes(), *b"\x12\x34\x00\x42\x00\x00\x00\xff");
        let period = Request::PeriodOnRobot { period_ms: 0x0102 };
        assert_eq!(period.bytes(), *b"\x12\x34\x00\x82\x00\x00\x01\x02");
    }

    #[test]
    fn absurd_scales_are_refused() {
        for value in [0.0, -1e6, f64::NAN, f64::INFINITY, 0.999, 1.001e9] {
            assert!(matches!(
                Scale::new(value, 1e6),
                Err(RdtError::Setting { what: "counts_per_newton", .. })
            ));
        }
        for value in [0.0, -1e6, f64::NAN, f64::INFINITY, 0.999, 1.001e12] {
            let error = Scale::new(1e6, value);
            assert!(matches!(error, Err(RdtError::Setting { what: "counts_per_newton_metre", .. })));
        }
        assert!(Scale::new(1.0, 1.0).is_ok() && Scale::new(1e9, 1e12).is_ok());
    }

    /// Flags of status words, and whether each is a mere warning.
    #[test]
    fn status_words_are_judged_by_the_manual() {
        let (good, warning, bad) = ((0, false), (0, true), (BAD_STATUS, false));
        let (full, bad_and_full) = ((SATURATED, false), (BAD_STATUS | SATURATED, false));
        for (variant, status, wanted) in [
            (Variant::NetFt, 0, good),
            (Variant::NetFt, ERROR, bad),
            (Variant::NetFt, THRESHOLD, warning),
            (Variant::NetFt, ERROR | THRESHOLD, warning),
            (Variant::NetFt, ERROR | THRESHOLD | 4, bad),
            (Variant::NetFt, NET_FT_SATURATED, full),
            (Variant::NetFt, ERROR | NET_FT_SATURATED, bad_and_full),
            (Variant::NetFt, AXIA_SATURATED, warning),
            (Variant::Axia, 0, good),
            (Variant::Axia, 0x8000_0008, bad),
            (Variant::Axia, 0x8800_0000, bad_and_full),
            (Variant::Axia, 0xc000_0000, bad_and_full),
            (Variant::Axia, 0x0001_0000, warning),
            (Variant::Axia, 0x1000_0000, warning),
            (Variant::Axia, NET_FT_SATURATED, warning),
            (Variant::OnRobot, 0, good),
            (Variant::OnRobot, 1, bad),
            (Variant::OnRobot, u32::MAX, bad),
        ] {
            assert_eq!(variant.judge(status), wanted, "{variant:?} {status:#x}");
        }
        for bit in [0, 1, 2, 5, 29] {
            assert_eq!(Variant::Axia.judge(1 << bit), bad, "bit {bit}");
            assert_eq!(Variant::Axia.judge(ERROR | 1 << bit), bad, "bit {bit}");
        }
    }
}
