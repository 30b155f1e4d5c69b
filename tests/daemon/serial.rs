//! Boards behind a serial line: codecs and clocks by themselves, and the whole over pseudo-terminals.

mod clock;
mod codecs;
mod daemon;
mod device;
mod port;
mod quiet;
