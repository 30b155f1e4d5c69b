//! A row may end in `*hh`: two hexadecimal digits, the XOR of all bytes before the asterisk, as in NMEA 0183.

/// The row without its checksum, and whether it had one.
pub fn check(row: &[u8]) -> Result<(&[u8], bool), String> {
    // Any other asterisk is a text column's.
    let Some((text, [b'*', digits @ ..])) = row.trim_ascii_end().split_last_chunk::<3>() else {
        return Ok((row, false));
    };
    let digits = String::from_utf8_lossy(digits);
    if !digits.bytes().all(|digit| digit.is_ascii_hexdigit()) {
        return Ok((row, false));
    }
    let right = text.iter().fold(0, |sum, byte| sum ^ byte);
    if u8::from_str_radix(&digits, 16) == Ok(right) {
        Ok((text, true))
    } else {
        Err(format!(
            "found checksum *{digits}, but must be *{right:02X}, the XOR of all bytes before the asterisk"
        ))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_checksum_is_taken_off_and_checked() {
        assert_eq!(check(b"1,2,3"), Ok((&b"1,2,3"[..], false)));
        // The one of the NMEA manual.
        let sentence = b"GPGLL,5057.970,N,00146.110,E,142451,A";
        for sum in ["*27", "*27 "] {
            let row = [&sentence[..], sum.as_bytes()].concat();
            assert_eq!(check(&row), Ok((&sentence[..], true)));
        }
        for row in ["1,2*2f", "1,2*2F"] {
            assert_eq!(check(row.as_bytes()), Ok((&b"1,2"[..], true)));
        }
        for sum in ["*28", "*27*27"] {
            let row = [&sentence[..], sum.as_bytes()].concat();
            assert!(check(&row).unwrap_err().contains("must be *"), "{sum}");
        }
        for text in ["*", "*2", "*270", "*+7", "*zz", ",ok*"] {
            let row = [&sentence[..], text.as_bytes()].concat();
            assert_eq!(check(&row), Ok((&row[..], false)));
        }
    }
}
