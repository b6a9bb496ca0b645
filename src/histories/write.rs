//! Histories as text: CCSDS AEM and OEM, STK `.a` and `.e`, CSV. What is written here is read back to 1e-12 (tests).

pub use crate::write_header::Header;
use crate::{attitude::AttitudeHistory, orbit::OrbitHistory};
use crate::{write_ccsds, write_csv, write_stk};
use std::io::{self, Write};

/// A format of attitudes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AttitudeFormat {
    /// CCSDS AEM, version 1, KVN: quaternions only.
    Aem1,
    /// CCSDS AEM, version 2, KVN.
    Aem2,
    /// CCSDS AEM, version 2, XML.
    Aem2Xml,
    /// STK `.a`.
    Stk,
    /// CSV with named columns.
    Csv,
}

/// A format of orbits.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum OrbitFormat {
    /// CCSDS OEM, version 2, KVN.
    Oem,
    /// CCSDS OEM, version 2, XML.
    OemXml,
    /// STK `.e`.
    Stk,
    /// CSV with named columns.
    Csv,
}

/// Writes a history with absolute times.
///
/// # Errors
/// When the output fails.
pub fn attitudes(
    out: &mut dyn Write,
    format: AttitudeFormat,
    history: &AttitudeHistory,
    header: &Header,
) -> io::Result<()> {
    match format {
        AttitudeFormat::Aem1 => write_ccsds::aem_kvn(out, history, header, true),
        AttitudeFormat::Aem2 => write_ccsds::aem_kvn(out, history, header, false),
        AttitudeFormat::Aem2Xml => write_ccsds::aem_xml(out, history, header),
        AttitudeFormat::Stk => write_stk::attitude(out, history),
        AttitudeFormat::Csv => write_csv::attitude(out, history, header),
    }
}

/// Writes an orbit.
///
/// # Errors
/// When the output fails.
pub fn orbit(out: &mut dyn Write, format: OrbitFormat, history: &OrbitHistory, header: &Header) -> io::Result<()> {
    match format {
        OrbitFormat::Oem => write_ccsds::oem_kvn(out, history, header),
        OrbitFormat::OemXml => write_ccsds::oem_xml(out, history, header),
        OrbitFormat::Stk => write_stk::ephemeris(out, history),
        OrbitFormat::Csv => write_csv::orbit(out, history),
    }
}
