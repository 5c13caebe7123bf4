//! What does each command do?

pub(crate) mod arguments;
pub(crate) mod build;
pub(crate) mod check;
pub(crate) mod layout;
pub(crate) mod localize;
