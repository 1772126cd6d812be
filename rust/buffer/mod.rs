//! The streaming wrench buffer: one writer, any number of readers, the oldest overwritten.
