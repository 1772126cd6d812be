//! What specifications have in common: fields that are set by name, and choices that callers and files make by name.

/// `with_field(value)` for fields of a struct that may grow, which callers can therefore not write out.
macro_rules! setters {
    ($spec:ty: $($with:ident $field:ident $type:ty,)*) => {
        impl $spec {$(
            #[doc = concat!("The same with this `", stringify!($field), "`.")]
            #[must_use]
            pub fn $with(mut self, $field: $type) -> Self {
                self.$field = $field;
                self
            }
        )*}
    };
}
pub(crate) use setters;

/// A table of choices and their names, both ways.
macro_rules! choices {
    ($choice:ty: $($name:literal $variant:ident,)*) => {
        impl $choice {
            /// Each with its name.
            pub const NAMED: [(&'static str, Self); [$($name),*].len()] = [$(($name, Self::$variant)),*];

            /// Its name.
            #[must_use]
            pub fn name(self) -> &'static str {
                match self {
                    $(Self::$variant => $name,)*
                }
            }
        }
    };
}
pub(crate) use choices;

/// The names of a table, for a message: `'drop' or 'clip'`.
pub fn listed<T>(named: &[(&str, T)]) -> String {
    named.iter().map(|(name, _)| format!("'{name}'")).collect::<Vec<_>>().join(" or ")
}
