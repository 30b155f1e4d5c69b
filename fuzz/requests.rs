//! Any bytes as a client's requests. The first byte is the limit of a request's length, the second says where the rest is
//! cut in two.

#![no_main]

use headingd::publish::framing::Requests;
use headingd::publish::gpsd::{WatchPolicy, error, watch};
use headingd::publish::request::ClientRequest;
use libfuzzer_sys::fuzz_target;
use serde_json::Value;

type Found = Vec<Result<ClientRequest, String>>;

fn feed(requests: &mut Requests, mut bytes: &[u8], found: &mut Found) {
    found.extend(std::iter::from_fn(|| requests.next(&mut bytes)));
    assert!(bytes.is_empty());
}

fuzz_target!(|data: &[u8]| {
    let [limit, cut, bytes @ ..] = data else {
        return;
    };
    // Long enough for `?POLL`.
    let limit = usize::from(*limit).max(5);
    let (mut whole, mut found) = (Requests::new(limit), Found::new());
    feed(&mut whole, bytes, &mut found);

    // Pieces make no difference.
    let (head, tail) = bytes.split_at(usize::from(*cut).min(bytes.len()));
    let (mut pieces, mut found_in_pieces) = (Requests::new(limit), Found::new());
    feed(&mut pieces, head, &mut found_in_pieces);
    feed(&mut pieces, tail, &mut found_in_pieces);
    assert_eq!(found, found_in_pieces);
    assert_eq!(pieces.finish(), whole.finish());

    // Nothing makes the next line unheard.
    let mut next = Found::new();
    feed(&mut pieces, head, &mut next);
    feed(&mut pieces, b"\n?POLL;", &mut next);
    assert_eq!(next.pop(), Some(Ok(ClientRequest::Poll)));

    // Every answer is a line of JSON.
    let mut policy = WatchPolicy::default();
    for request in found {
        let answer = match request {
            Ok(ClientRequest::Watch(request)) => {
                request.apply(&mut policy);
                watch(&policy)
            }
            Ok(_) => continue,
            Err(message) => error(&message),
        };
        assert!(!answer.contains(['\r', '\n']), "{answer}");
        let answer: Value = serde_json::from_str(&answer).expect("an answer is JSON");
        assert!(answer["class"].is_string(), "{answer}");
    }
});
