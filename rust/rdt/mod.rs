//! Wrenches from an F/T sensor that speaks RDT over UDP.
