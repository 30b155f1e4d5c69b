"""Holds the headings that a program received against those that the daemon sent.

    compare.py NAME LEAST DAEMON         reads from standard input lines of TIME KIND DEGREES [KIND DEGREES],
                                         of ATT, or of NMEA 0183; there must be so many at least
    compare.py --whole NAME FILE         looks for gaps in the seq of the ATT in the file

KIND is true or magnetic. TIME is that of the ATT, as text or in seconds since 1970, and - where the program does not hear of
it: then headings must be among the daemon's, in the daemon's order.
"""

import datetime
import json
import sys
import time

KEYS = {"true": "heading", "magnetic": "mheading"}
# What rounding to a tenth leaves, and to a hundredth.
TENTH, HUNDREDTH = 0.0501, 0.0051


def atts(path):
    for line in open(path):
        if line.startswith('{"class":"ATT"'):
            # The last line may not be there whole yet.
            try:
                yield json.loads(line)
            except json.JSONDecodeError:
                return


def milliseconds(text):
    try:
        return round(1000 * float(text))
    except ValueError:
        moment = datetime.datetime.fromisoformat(text.replace("Z", "+00:00"))
        return round(1000 * moment.timestamp())


def near(a, b, by):
    return abs((a - b + 180) % 360 - 180) <= by


def reports(lines):
    """TIME, and the headings by their kinds."""
    for line in lines:
        words = line.split()
        if line.startswith('{"class":"ATT"'):
            att = json.loads(line)
            headings = {kind: att[key] for kind, key in KEYS.items() if key in att}
            # A machine that is too busy for half a second has none.
            if headings:
                yield att.get("time", "-"), headings
        elif line.startswith("$"):
            body, sum_ = line[1:].strip().split("*")
            right = 0
            for byte in body.encode():
                right ^= byte
            assert int(sum_, 16) == right, line
            fields = body.split(",")
            kind = {"HCHDM": "magnetic", "HCHDG": "magnetic", "HCHDT": "true"}.get(fields[0])
            if kind:
                yield "-", {kind: float(fields[1])}
        elif not line.startswith("{"):
            yield words[0], {kind: float(value) for kind, value in zip(words[1::2], words[2::2])}


def compare(name, least, path):
    received = list(reports(sys.stdin))
    assert len(received) >= least, f"{len(received)} headings, not {least}"
    if not received:
        return "connected, and found the device"
    sent = list(atts(path))
    # On a machine that is busy, several are of the same millisecond.
    by_time = {}
    for att in sent:
        by_time.setdefault(milliseconds(att["time"]), []).append(att)
    at = {kind: 0 for kind in KEYS}
    for moment, headings in received:
        for kind, degrees in headings.items():
            if moment != "-":
                then = by_time[milliseconds(moment)]
                right = [one for one in then if near(one.get(KEYS[kind], float("nan")), degrees, HUNDREDTH)]
                assert right, f"{kind} {degrees}: {then}"
                att = right[0]
                continue
            while not (KEYS[kind] in sent[at[kind]] and near(sent[at[kind]][KEYS[kind]], degrees, TENTH)):
                at[kind] += 1
                assert at[kind] < len(sent), f"{kind} {degrees} was not sent, or not in this order"
            att = sent[at[kind]]
    kind, degrees = list(headings.items())[-1]
    return f"{len(received)} headings, the last {kind} {degrees:.2f}; the daemon's {att[KEYS[kind]]:.2f}"


def whole(path):
    numbers = [att["seq"] for att in atts(path)]
    lost = numbers[-1] - numbers[0] + 1 - len(numbers)
    assert lost == 0 and numbers == sorted(numbers), f"lost {lost} of {len(numbers)}"
    return f"none of {len(numbers)} headings was lost"


name = sys.argv[2] if sys.argv[1] == "--whole" else sys.argv[1]
try:
    if sys.argv[1] == "--whole":
        print(f"{name}: {whole(sys.argv[3])}")
    else:
        # What the daemon sent may be a moment late in the file.
        time.sleep(0.2)
        print(f"{name}: {compare(name, int(sys.argv[2]), sys.argv[3])}")
except (AssertionError, LookupError, ValueError) as error:
    sys.exit(f"{name}: FAILED: {type(error).__name__}: {error}")
