//! Records as a box sends them: 36 bytes each, big-endian, one to forty in a datagram.

/// Bytes of a record.
pub const RECORD_BYTES: usize = 36;

/// The most records a datagram can hold: forty fill an Ethernet frame.
pub const MAX_RECORDS: usize = 40;

/// Bytes of the longest datagram, and one that tells a longer one.
pub(super) const ROOM: usize = RECORD_BYTES * MAX_RECORDS + 1;

/// One record, still in counts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Record {
    /// Number of the record within the stream that was asked for, from 1; 0 follows 2^32 - 1.
    pub rdt_sequence: u32,
    /// Number of the sample within the sensor, which takes more samples than it sends.
    pub ft_sequence: u32,
    /// Bits that say how the sensor is: see [`Variant`](super::Variant).
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
    fn records_come_in_order() {
        let mut datagram = GOLDEN.to_vec();
        datagram.extend(GOLDEN);
        datagram[39] = 2;
        let numbers: Vec<u32> = records(&datagram).unwrap().map(|record| record.rdt_sequence).collect();
        assert_eq!(numbers, [1, 2]);
    }
}
