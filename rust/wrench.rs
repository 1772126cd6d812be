//! Axis order and units of a wrench: the one place where axes are listed.

/// Names of the six axes in storage order: forces, then torques.
pub const AXES: [&str; 6] = ["fx", "fy", "fz", "tx", "ty", "tz"];

/// Units of the six axes, in the order of [`AXES`].
pub const UNITS: [&str; 6] = ["N", "N", "N", "N m", "N m", "N m"];

/// Name of axis `axis` of a recording with `n_axes` axes.
///
/// A full wrench has the names of [`AXES`]; any other number of axes is numbered.
///
/// ```
/// assert_eq!(granular_id::wrench::axis_name(2, 6), "fz");
/// assert_eq!(granular_id::wrench::axis_name(2, 3), "axis2");
/// ```
#[must_use]
pub fn axis_name(axis: usize, n_axes: usize) -> String {
    if n_axes == AXES.len() && axis < AXES.len() {
        AXES[axis].to_owned()
    } else {
        format!("axis{axis}")
    }
}
