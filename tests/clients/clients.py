"""Headings by libraries of Python: clients.py LIBRARY PORT prints TIME KIND DEGREES of a hundred."""

import asyncio
import socket
import sys

HOST, COUNT = "127.0.0.1", 100
name, port = sys.argv[1], int(sys.argv[2])


def python3_gps():
    import gps

    session = gps.gps(host=HOST, port=str(port), mode=gps.WATCH_ENABLE | gps.WATCH_NEWSTYLE)
    count = 0
    for report in session:
        if report["class"] == "ATT" and "heading" in report:
            print(report["time"], "true", report["heading"], "magnetic", report["mheading"])
            count += 1
            if count == COUNT:
                return


def gps3(module):
    link = module.GPSDSocket()
    link.connect(host=HOST, port=port)
    link.watch()
    stream = module.DataStream()
    count = 0
    for new in link:
        if new and '"class":"ATT"' in new:
            # gps3 keeps what it knows in dictionaries, agps3 in attributes.
            stream.unpack(new)
            att = getattr(stream, "ATT", None)
            time, heading = (att["time"], att["heading"]) if att else (stream.time, stream.heading)
            if heading == "n/a":
                continue
            print(time, "true", heading)
            count += 1
            if count == COUNT:
                return


def gpsd_py3():
    import gpsd

    gpsd.connect(host=HOST, port=port)
    device = gpsd.device()
    assert device["driver"] == "headingd" and device["path"] == "simulator", device


async def asyncio_gpsd_client():
    from asyncio_gpsd_client import GpsdClient

    async with GpsdClient(HOST, port) as client:
        assert client.devices.devices[0].driver == "headingd", client.devices
        assert client.watch.enable, client.watch


def pynmea2():
    import pynmea2 as nmea

    with socket.create_connection((HOST, port)) as link:
        link.sendall(b'?WATCH={"class":"WATCH", "nmea":true}')
        count = 0
        for line in link.makefile(newline="\r\n"):
            if line.startswith("{"):
                continue
            sentence = nmea.parse(line.strip(), check=True)
            kind = sentence.sentence_type
            if kind == "HDM":
                print("-", "magnetic", sentence.heading)
            elif kind == "HDT":
                print("-", "true", sentence.heading)
            elif kind == "HDG":
                assert (float(sentence.variation), sentence.var_dir) == (13.3, "E"), line
                print("-", "magnetic", sentence.heading)
            elif kind == "XDR":
                names = [sentence.get_transducer(at).id for at in range(sentence.num_transducers)]
                assert names == ["PTCH", "ROLL"], line
            else:
                assert kind == "ROT" and sentence.status == "A", line
            count += 1
            if count == 5 * COUNT:
                return


if name == "python3-gps":
    python3_gps()
elif name == "gps3":
    from gps3 import gps3 as library

    gps3(library)
elif name == "agps3":
    from gps3 import agps3 as library

    gps3(library)
elif name == "gpsd-py3":
    gpsd_py3()
elif name == "asyncio-gpsd-client":
    asyncio.run(asyncio_gpsd_client())
elif name == "pynmea2":
    pynmea2()
else:
    sys.exit(f"there is no {name} here")
