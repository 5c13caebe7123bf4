//! What must hold of grids, whatever they are made of.

mod cells;
mod exchange;
mod history;
mod localize;
mod temporal;
mod twin;
