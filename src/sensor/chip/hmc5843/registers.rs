//! Registers of the HMC5843 and its variants (data sheet 900367 and HMC5883 manual; kernel's `hmc5843_core.c`).

pub(super) const ADDRESS: u8 = 0x1E;

/// CRA: rate in bits 4:2, measurement bias in 1:0; averaging in 6:5 on an HMC5883L.
pub(super) const CRA: u8 = 0x00;
/// CRB: gain in bits 7:5.
pub(super) const CRB: u8 = 0x01;
pub(super) const MODE: u8 = 0x02;
/// Six registers, high byte first.
pub(super) const DATA: u8 = 0x03;
pub(super) const STATUS: u8 = 0x09;
pub(super) const IDENTITY: u8 = 0x0A;

/// What the three identity registers hold, on all variants.
pub(super) const H43: [u8; 3] = *b"H43";

pub(super) const CONTINUOUS: u8 = 0x00;
pub(super) const SINGLE: u8 = 0x01;

/// STATUS: all six data registers are written.
pub(super) const RDY: u8 = 0x01;

/// Rate code of CRA that is the fastest that all variants have.
pub(super) const FASTEST: u8 = 6;

/// Measurement bias of CRA.
pub(super) const NO_BIAS: u8 = 0;
pub(super) const POSITIVE_BIAS: u8 = 1;
pub(super) const NEGATIVE_BIAS: u8 = 2;

/// CRA with this rate code and measurement bias.
pub(super) const fn cra(rate: u8, bias: u8) -> u8 {
    rate << 2 | bias
}

/// CRB with this gain code.
pub(super) const fn crb(gain: u8) -> u8 {
    gain << 5
}
