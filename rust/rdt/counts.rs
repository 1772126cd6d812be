//! What a stream consisted of, counted exactly.

/// Numbers of a stream since its start. Every datagram and every record is counted under exactly one reason:
/// `records = rows + duplicates + stale + implausible + out_of_range`, but for one record that may wait for the next.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    /// Datagrams that arrived.
    pub datagrams: u64,
    /// Datagrams of another length than 1 to 40 records.
    pub malformed: u64,
    /// Records in the datagrams that were well-formed.
    pub records: u64,
    /// Records handed on.
    pub rows: u64,
    /// Records missing from the numbering of the stream; one that arrives late is taken off again.
    pub lost: u64,
    /// Records that came after one with a higher number; they are among the rows.
    pub reordered: u64,
    /// Records that came again.
    pub duplicates: u64,
    /// Records of a sample that an earlier record brought, under a new number.
    pub stale: u64,
    /// Records that continue nothing, and that no later record continues.
    pub implausible: u64,
    /// Records with a force or torque beyond all sense for the sensor.
    pub out_of_range: u64,
    /// Times that the numbering began anew.
    pub restarts: u64,
    /// Rows whose status word is an error.
    pub bad_status: u64,
    /// Rows whose status word, or a count at the end of its 32 bits, says saturation.
    pub saturated: u64,
    /// Rows whose status word is a mere warning.
    pub warnings: u64,
}
