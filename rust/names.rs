//! Choices that callers and files make by name: each choice has a table, where both are.

/// The name of a value in its table.
pub(crate) fn of<T: Copy + PartialEq>(value: T, named: &[(&'static str, T)]) -> &'static str {
    named.iter().find(|(_, meaning)| *meaning == value).map_or("", |(name, _)| name)
}

/// The names of a table, for a message: `'drop' or 'clip'`.
pub fn listed<T>(named: &[(&str, T)]) -> String {
    named.iter().map(|(name, _)| format!("'{name}'")).collect::<Vec<_>>().join(" or ")
}
