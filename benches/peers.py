#!/usr/bin/env python3
"""Headings of headingd and of other libraries from the same logs, beside the truth in their column heading_deg.

    pip install numpy==2.4.6 imufusion==1.3.3 vqf==2.1.2
    benches/peers.py target/deb/headingd LOG...

The others do not calibrate: they get the magnetometer as it is, and once more corrected by an ellipsoid that was fitted to the
whole log beforehand, which nobody has in real time. Errors are those at the samples for which headingd published a heading.

Costs are processor time for a second of the log, the least of several runs. That of headingd is the whole program: it starts, reads
the log, calibrates, and writes each heading as JSON. VQF's is its C++ alone. Fusion's has a call from Python for each sample of
the gyro in it, which is most of it.
"""

import csv
import json
import resource
import subprocess
import sys
import time

import imufusion
import numpy as np
from vqf import VQF

GRAVITY = 9.80665
# Other work on the machine only ever adds time.
RUNS = 9


def signed_axes(text):
    rows = np.zeros((3, 3))
    for row, word in enumerate(text.split()):
        rows[row, "xyz".index(word[1])] = -1 if word[0] == "-" else 1
    return rows


def read(path):
    """Times, and in body axes rates (rad/s), forces (m/s²), fields and the truth; NaN where there is none."""
    header, rows = {}, []
    with open(path, newline="") as file:
        for line in file:
            if line.startswith("#"):
                key, _, value = line[1:].partition("=")
                header[key.strip()] = value.strip()
            else:
                break
        names = line.strip().split(",")
        for row in csv.reader(file):
            rows.append([float(cell) if cell else np.nan for cell in row])
    table = np.array(rows)
    column = lambda name: table[:, names.index(name)] if name in names else np.full(len(table), np.nan)
    triple = lambda letter: np.stack([column(letter + axis) for axis in "xyz"], axis=1)
    turned = lambda chip, raw: raw @ signed_axes(header.get(chip + "_axes", "+x +y +z")).T
    rate, force, field = triple("g"), triple("a"), triple("m")
    if header.get("gyro_unit") == "deg/s":
        rate = np.radians(rate)
    if header.get("accel_unit") == "g":
        force = force * GRAVITY
    return column("t_s"), turned("gyro", rate), turned("accel", force), turned("mag", field), column("heading_deg")


def ellipsoid(field):
    """Least squares of the general quadric: the field corrected to a sphere."""
    seen = field[~np.isnan(field).any(axis=1)]
    scale = np.abs(seen).max()
    x, y, z = (seen / scale).T
    design = np.stack([x * x, y * y, z * z, 2 * x * y, 2 * x * z, 2 * y * z, 2 * x, 2 * y, 2 * z], axis=1)
    a, b, c, d, e, f, g, h, i = np.linalg.lstsq(design, np.ones(len(seen)), rcond=None)[0]
    quadric, linear = np.array([[a, d, e], [d, b, f], [e, f, c]]), np.array([g, h, i])
    centre = -np.linalg.solve(quadric, linear)
    values, vectors = np.linalg.eigh(quadric / (1 + centre @ quadric @ centre))
    if values.min() <= 0:
        return None
    return (field / scale - centre) @ (vectors * np.sqrt(values)) @ vectors.T


def azimuth(quaternion):
    """Of the x axis, from the first axis of the earth's frame towards the second, degrees."""
    w, x, y, z = quaternion
    return np.degrees(np.arctan2(2 * (x * y + w * z), 1 - 2 * (y * y + z * z)))


def with_vqf(t_s, rate, force, field):
    has_rate, has_field = ~np.isnan(rate[:, 0]), ~np.isnan(field).any(axis=1)
    period = lambda there: float(np.diff(t_s[there]).mean())
    filter = VQF(period(has_rate), period(~np.isnan(force[:, 0])), period(has_field))
    for i in range(len(t_s)):
        if has_rate[i]:
            filter.updateGyr(np.ascontiguousarray(rate[i]))
        if not np.isnan(force[i, 0]):
            filter.updateAcc(np.ascontiguousarray(force[i]))
        if has_field[i]:
            filter.updateMag(np.ascontiguousarray(field[i]))
            # East, north, up.
            yield i, 90 - azimuth(filter.getQuat9D())


def fusion(t_s, rate):
    settings, bias_settings = imufusion.AhrsSettings(), imufusion.BiasSettings()
    settings.sample_rate = bias_settings.sample_rate = 1 / np.diff(t_s[~np.isnan(rate[:, 0])]).mean()
    settings.convention = imufusion.CONVENTION_NED
    # As its manual has it.
    settings.gain, settings.gyroscope_range = 0.5, 2000
    settings.acceleration_rejection = settings.magnetic_rejection = 10
    settings.rejection_timeout = 5
    filter, bias = imufusion.Ahrs(), imufusion.Bias()
    filter.set_settings(settings)
    bias.set_settings(bias_settings)
    return filter, bias


def with_fusion(t_s, rate, force, field):
    filter, bias = fusion(t_s, rate)
    felt, seen = None, None
    for i in range(len(t_s)):
        if not np.isnan(force[i, 0]):
            felt = force[i] / GRAVITY
        has_field = not np.isnan(field[i]).any()
        if has_field:
            seen = field[i]
        if not np.isnan(rate[i, 0]) and felt is not None and seen is not None:
            filter.update(bias.update(np.degrees(rate[i])), felt, seen)
        if has_field:
            yield i, azimuth(filter.get_quaternion())


def with_headingd(program, path):
    said = subprocess.run([program, "replay", path], check=True, capture_output=True, text=True).stdout
    for line in said.splitlines():
        message = json.loads(line)
        if message["class"] == "ATT" and "mheading" in message:
            yield message["t_s"], message["mheading"]


def held(table):
    """Each row with the last numbers known there; before the first, those."""
    known = ~np.isnan(table).any(axis=1)
    last = np.maximum.accumulate(np.where(known, np.arange(len(table)), 0))
    return table[np.maximum(last, np.argmax(known))]


def costs(program, path, t_s, rate, force, field):
    """Processor time for a second of the log, microseconds: headingd, VQF, Fusion."""
    has_rate = ~np.isnan(rate[:, 0])
    rate_, force_, field_ = (np.ascontiguousarray(held(table)[has_rate]) for table in (rate, force, field))
    degrees, felt = np.degrees(rate_), force_ / GRAVITY
    period_s = float(np.diff(t_s[has_rate]).mean())

    def headingd():
        subprocess.run([program, "replay", path], check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)

    def vqf():
        VQF(period_s).updateBatch(rate_, force_, field_)

    def fused():
        filter, bias = fusion(t_s, rate)
        for i in range(len(degrees)):
            filter.update(bias.update(degrees[i]), felt[i], field_[i])

    def seconds():
        children = resource.getrusage(resource.RUSAGE_CHILDREN)
        return time.process_time(), children.ru_utime + children.ru_stime

    for work, which in ((headingd, 1), (vqf, 0), (fused, 0)):
        least = np.inf
        for _ in range(RUNS):
            begun = seconds()[which]
            work()
            least = min(least, seconds()[which] - begun)
        yield f"{1e6 * least / (t_s[-1] - t_s[0]):.0f} µs"


def rms(errors):
    errors = (np.array(errors) + 180) % 360 - 180
    return f"{np.sqrt(np.mean(errors**2)):.1f}°"


print("log | published | headingd | VQF | and an ellipsoid | Fusion | and an ellipsoid | cost: headingd | VQF | Fusion")
for path in sys.argv[2:]:
    t_s, rate, force, field, truth = read(path)
    index = {round(t, 6): i for i, t in enumerate(t_s)}
    ours = {index[round(t, 6)]: heading for t, heading in with_headingd(sys.argv[1], path)}
    known = ~np.isnan(field).any(axis=1) & ~np.isnan(truth)
    counted = [i for i in ours if known[i]]
    cells = [rms([ours[i] - truth[i] for i in counted])]
    fitted = ellipsoid(field)
    for method in (with_vqf, with_fusion):
        for given in (field, fitted):
            if given is None:
                cells.append("none fits")
                continue
            found = dict(method(t_s, rate, force, given))
            cells.append(rms([found[i] - truth[i] for i in counted]))
    cells.extend(costs(sys.argv[1], path, t_s, rate, force, field))
    print(path.rsplit("/", 1)[-1], f"{len(counted) / known.sum():.0%}", *cells, sep=" | ", flush=True)
