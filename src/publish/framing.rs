//! Cuts a client's bytes into requests, as gpsd does.
//!
//! A request ends where the JSON object of its argument closes, at a `;`, or at the end of its line, whichever comes
//! first; a `;` within the object's strings is part of them. Several requests may share a line, and one may arrive in
//! pieces.

use super::request::{ClientRequest, parse};

/// Cuts bytes into requests. It holds no more than one unfinished request, of a bounded length.
#[derive(Debug, Default)]
pub struct Requests {
    pending: Vec<u8>,
    limit_bytes: usize,
    part: Part,
    in_string: bool,
    escaped: bool,
    skipping: bool,
}

/// Where in a request the next byte belongs.
#[derive(Clone, Copy, Debug, Default)]
enum Part {
    #[default]
    Name,
    /// Behind the `=`.
    Argument,
    /// In so many open braces of the argument.
    Object(usize),
    /// In an argument that is no object.
    Other,
}

impl Requests {
    /// Requests of up to `limit_bytes` bytes each.
    pub fn new(limit_bytes: usize) -> Self {
        Self {
            limit_bytes,
            ..Self::default()
        }
    }

    /// Returns the next request that `bytes` complete, and advances `bytes` past it; past all of them if none is complete.
    /// A request that cannot be understood is an error text for the client; after one that is too long, everything up to
    /// the next newline is discarded.
    pub fn next(&mut self, bytes: &mut &[u8]) -> Option<Result<ClientRequest, String>> {
        while let Some((&byte, rest)) = bytes.split_first() {
            *bytes = rest;
            let found = if byte == b'\n' {
                self.skipping = false;
                self.finish()
            } else if self.skipping {
                None
            } else if byte == b';' && !self.in_string {
                self.finish()
            } else if self.pending.len() == self.limit_bytes {
                self.begin_anew();
                self.skipping = true;
                Some(Err(format!(
                    "the request is longer than {} bytes (socket.request_limit_bytes); the rest of its line is ignored",
                    self.limit_bytes
                )))
            } else if self.push(byte) {
                self.finish()
            } else {
                None
            };
            if found.is_some() {
                return found;
            }
        }
        None
    }

    /// Takes a byte of the request, and says whether it closes the argument's object.
    fn push(&mut self, byte: u8) -> bool {
        self.pending.push(byte);
        if self.escaped {
            self.escaped = false;
        } else if self.in_string {
            self.escaped = byte == b'\\';
            self.in_string = byte != b'"';
        } else {
            self.in_string = byte == b'"';
            self.part = match (self.part, byte) {
                (Part::Name, b'=') => Part::Argument,
                (Part::Argument, b'{') => Part::Object(1),
                (Part::Argument, byte) if !byte.is_ascii_whitespace() => Part::Other,
                (Part::Object(depth), b'{') => Part::Object(depth + 1),
                (Part::Object(depth), b'}') => Part::Object(depth - 1),
                (part, _) => part,
            };
        }
        matches!(self.part, Part::Object(0))
    }

    /// The request that the end of the stream completes, if there is one: `printf '?POLL'` sends no newline.
    pub fn finish(&mut self) -> Option<Result<ClientRequest, String>> {
        // Empty requests cost nothing.
        if self.pending.is_empty() {
            return None;
        }
        let text = String::from_utf8_lossy(&self.pending);
        let text = text.trim();
        let request = (!text.is_empty()).then(|| parse(text));
        self.begin_anew();
        request
    }

    fn begin_anew(&mut self) {
        self.pending.clear();
        self.part = Part::default();
        self.in_string = false;
        self.escaped = false;
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;
    use serde_json::{Deserializer, Value};

    use super::*;

    fn fed(requests: &mut Requests, mut bytes: &[u8]) -> Vec<Result<ClientRequest, String>> {
        let found = std::iter::from_fn(|| requests.next(&mut bytes)).collect();
        assert!(bytes.is_empty());
        found
    }

    fn requests(text: &str) -> Vec<Result<ClientRequest, String>> {
        fed(&mut Requests::new(1024), text.as_bytes())
    }

    #[test]
    fn every_request_is_known_with_and_without_its_semicolon() {
        for (text, request) in [
            ("?WATCH", ClientRequest::Policy),
            ("?POLL", ClientRequest::Poll),
            ("?DEVICES", ClientRequest::Devices),
            ("?DEVICE", ClientRequest::Device),
            ("?VERSION", ClientRequest::Version),
        ] {
            for end in [";", "\n", ";\n", ";\r\n", "\r\n", " ; \r\n\r\n"] {
                assert_eq!(requests(&format!("{text}{end}")), [Ok(request.clone())]);
            }
        }
    }

    #[test]
    fn a_request_ends_where_its_object_closes() {
        for end in ["", ";", "\n", ";\n", " ;\r\n"] {
            let found = requests(&format!("?WATCH={{\"enable\":true}}{end}"));
            assert_eq!(found.len(), 1, "{end:?}: {found:?}");
            assert!(found[0].is_ok(), "{end:?}: {found:?}");
        }
        assert_eq!(requests("?WATCH = {\"json\":true}?POLL;").len(), 2);
        // What is no object ends as before.
        assert_eq!(requests("?DEVICE=[{}]").len(), 0);
        assert_eq!(requests("?DEVICE=[{}];").len(), 1);
        assert_eq!(requests("{}").len(), 0);
    }

    #[test]
    fn a_broken_object_is_one_error_and_the_next_line_is_read_again() {
        for broken in [
            "?WATCH={\n",
            "?WATCH={\"enable\n",
            "?WATCH={{\"enable\":true}\n",
            "?WATCH={enable:true}\n",
            "?WATCH={\"enable\":true,}\n",
            "?WATCH={\"enable\":[}\n",
            "?WATCH=;",
            "?WATCH=[];",
            "?POLL={};",
            "\u{0};",
        ] {
            let found = requests(&format!("{broken}?POLL;"));
            assert_eq!(found.len(), 2, "{broken:?}: {found:?}");
            assert!(found[0].is_err() && found[1].is_ok(), "{broken:?}");
        }
    }

    #[test]
    fn an_overlong_request_is_one_error_and_the_next_line_is_read_again() {
        let mut requests = Requests::new(16);
        assert_eq!(fed(&mut requests, &[b'x'; 16]), []);
        assert_eq!(fed(&mut requests, &[b'x'; 5000]).len(), 1);
        assert_eq!(
            fed(&mut requests, b"?POLL;\"\n?POLL;"),
            [Ok(ClientRequest::Poll)]
        );
        assert!(requests.pending.capacity() <= 64);
    }

    /// Any JSON object, with strings that are made to confuse.
    fn object() -> impl Strategy<Value = Value> {
        let text = "[a-z{}\\[\\]\"\\\\;=?é]{0,8}";
        let leaf = prop_oneof![
            any::<bool>().prop_map(Value::from),
            any::<i64>().prop_map(Value::from),
            text.prop_map(Value::from),
        ];
        let map = move |inner| prop::collection::btree_map(text, inner, 0..4);
        let value = leaf.prop_recursive(3, 16, 4, move |inner| {
            prop_oneof![
                prop::collection::vec(inner.clone(), 0..4).prop_map(Value::from),
                map(inner).prop_map(|members| members.into_iter().collect()),
            ]
        });
        map(value.boxed()).prop_map(|members| members.into_iter().collect())
    }

    proptest! {
        /// Where serde_json's own reader of a stream says that the object ends.
        #[test]
        fn any_object_ends_at_its_closing_brace(
            object in object(),
            pretty in any::<bool>(),
            rest in "[ -~]{0,20}",
        ) {
            let mut text = if pretty {
                // A newline ends a request.
                serde_json::to_string_pretty(&object).unwrap().replace('\n', " ")
            } else {
                object.to_string()
            };
            text += &rest;
            let mut stream = Deserializer::from_str(&text).into_iter::<Value>();
            prop_assert_eq!(stream.next().unwrap().unwrap(), object);
            let end = stream.byte_offset();
            let whole = format!("?WATCH={text}");
            let mut bytes = whole.as_bytes();
            prop_assert!(Requests::new(65_536).next(&mut bytes).is_some());
            prop_assert_eq!(bytes, &text.as_bytes()[end..]);
        }

        #[test]
        fn any_bytes_in_any_pieces_give_the_same_and_never_panic(
            bytes in prop::collection::vec(
                prop_oneof![any::<u8>(), prop::sample::select(b"?WATCH={\"enable\":true};\\\n{}=".to_vec())],
                0..200,
            ),
            cut in 0usize..200,
            limit in 1usize..64,
        ) {
            let mut whole = Requests::new(limit);
            let mut expected = fed(&mut whole, &bytes);
            expected.extend(whole.finish());
            let (head, tail) = bytes.split_at(cut.min(bytes.len()));
            let mut pieces = Requests::new(limit);
            let mut found = fed(&mut pieces, head);
            found.extend(fed(&mut pieces, tail));
            prop_assert!(pieces.pending.len() <= limit);
            found.extend(pieces.finish());
            prop_assert_eq!(found, expected);
        }

        /// After any rubbish a newline makes sure that the next request is heard.
        #[test]
        fn nothing_that_a_client_sends_makes_the_next_line_unheard(
            rubbish in prop::collection::vec(any::<u8>(), 0..200),
            limit in 16usize..64,
        ) {
            let mut requests = Requests::new(limit);
            fed(&mut requests, &rubbish);
            prop_assert_eq!(fed(&mut requests, b"\n?POLL;").pop(), Some(Ok(ClientRequest::Poll)));
        }
    }
}
