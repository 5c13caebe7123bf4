//! What must hold of grids, whatever they are made of.

mod cells;
mod localize;
