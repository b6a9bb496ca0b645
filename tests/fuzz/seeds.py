#!/usr/bin/env python3
"""Writes the seeds in tests/fuzz/corpus: the published bytes of every message, and captures and lines made by hand.

    python3 tests/fuzz/seeds.py

Needed only after a change of firmware_protocol/vectors.json or of how a target takes its input apart.
"""

import gzip
import json
import struct
from pathlib import Path

HERE = Path(__file__).parent
VECTORS = json.loads((HERE / "../../firmware_protocol/vectors.json").read_text())
# Message numbers in the order of MessageId::ALL.
NUMBERS = [0x08, 0x18, 0x19, 0x1A, 0x20, 0x21, 0x22, 0x23, 0x24, 0x25, 0x28, 0x2A, 0x30, 0x31, 0x48, 0x58, 0x60, 0x70]
AS_IT_IS = 2  # the frame is not sealed by the target
STREAM = 2


def frame(vector, entry):
    number = int(entry["id"], 16) - vector["base"] >> 4
    data = bytes.fromhex(entry["data"])
    return bytes([NUMBERS.index(number) << 3 | (len(data) > 8), AS_IT_IS]) + data


def can_decode():
    groups = {}
    for vector in VECTORS["messages"]:
        frames = [vector["fd"]] + (vector["classic"] or [])
        groups.setdefault((vector["base"], vector["node"]), []).extend(frame(vector, entry) for entry in frames)
    for (base, node), frames in groups.items():
        yield f"vectors_{base:02x}_{node}", bytes([node << 4 | STREAM, base >> 4]) + b"".join(frames)
    sealed = b"".join(bytes([NUMBERS.index(n) << 3, 0]) + bytes(8) for n in (0x21, 0x22))
    yield "group", bytes([STREAM, 0]) + sealed + bytes([NUMBERS.index(0x25) << 3, 0]) + bytes(8)
    yield "record", bytes([STREAM, 0, NUMBERS.index(0x30) << 3 | 1, 0]) + struct.pack("<IBBH", 7, 1, 3, 0) + bytes(range(40))
    # Flags, time tag, sequence number, quaternion, rates, then kind and places of the damage.
    record = bytes([3, 1, 2, 3, 4, 9]) + bytes(range(1, 9)) + bytes(range(24))
    for kind, name in ((0, "fd"), (1, "group")):
        yield f"damage_{name}_three", bytes([kind, 0]) + record + bytes([2, 5, 0, 9, 0, 80, 0])
        yield f"damage_{name}_burst", bytes([kind, 0]) + record + bytes([3, 0xFF, 0xFF, 40, 0])


def serial_resync():
    head = bytes([0, 1, 0, 2]) + bytes([3, 1, 2, 3, 4, 9]) + bytes(range(1, 9)) + bytes(range(24)) + bytes(range(8))
    lines = [bytes.fromhex(vector["serial"]["data"]) for vector in VECTORS["messages"] if vector.get("serial")]
    yield "silence", head
    yield "vectors", head + b"".join(lines)[:1200]
    yield "cut", head + b"".join(line[: len(line) // 2] for line in lines)[:600]
    yield "oversize", head + bytes([1]) * 100 + bytes([0, 5, 5, 0, 0])


def slcan():
    lines = [b"\r\r\rC\rS6\rY5\rO\r", b"t1232AABB\rZ1\r", b"d3019" + b"5A" * 12 + b"\rb301F" + b"a5" * 64 + b"\r",
             b"T000001230\rr1230\rM00000000\rmFFFFFFFF\r", b"V\r\nv\r\nN\r\nF\r\nL\r", b"t800\rS9\rt12x0\rQ\r" + b"D" * 140 + b"\rO\r"]
    for place, line in enumerate(lines):
        yield f"lines_{place}", bytes([2, 0, 7, 30]) + line


def socketcand():
    texts = [b"< open can0 >< rawmode >", b"< send 123 2 11 22 >< send 7ff 8 1 2 3 4 5 6 7 8 >", b"< echo > x < send 12< echo >\r\n",
             b"< add 1 0 123 0 >< send 00000123 0 >< open abcdefghijklmnop >", b"<" + b"x" * 130 + b">< echo >\0"]
    for place, text in enumerate(texts):
        yield f"elements_{place}", bytes([2, 0, 7, 30]) + text


def block(kind, body, order="<"):
    body += bytes(-len(body) % 4)
    length = struct.pack(order + "I", len(body) + 12)
    return struct.pack(order + "I", kind) + length + body + length


def option(code, value, order="<"):
    return struct.pack(order + "HH", code, len(value)) + value + bytes(-len(value) % 4)


def packet(interface, data, order="<"):
    options = option(2, struct.pack(order + "I", 2), order) + option(1, b"TAI 1772366437000000000 ns", order)
    return struct.pack(order + "5I", interface, 412659, 1077936128, len(data), len(data)) + data + bytes(-len(data) % 4) + options


def captures():
    any_file, any_blocks, line, packets = bytes([0]), bytes([1]), bytes([2]), bytes([3])
    log = b"(1772366400.123456789) can0 123#DEADBEEF R\n(1.5) vcan0 301##1" + b"5A" * 12 + b" T\n(0.0) can1 00000123#R\n\n"
    yield "candump", any_file + log
    yield "candump_cut", any_file + log[:60]
    yield "line", line + b"(1772366400.000001) can0 7FF#1122334455667788_9 T"
    can = struct.pack(">IBBH", 0x123, 2, 0, 0) + b"\x11\x22"
    for name, order in (("little", "<"), ("big", ">")):
        bodies = [(1, struct.pack(order + "HHI", kind, 0, 0) + option(9, b"\x09", order)) for kind in (227, 147)]
        bodies += [(6, packet(0, can, order)), (6, packet(1, b"starloop" * 12, order)), (3, bytes(8))]
        section = block(0x0A0D0D0A, struct.pack(order + "IHHq", 0x1A2B3C4D, 1, 0, -1), order)
        file = section + b"".join(block(kind, body, order) for kind, body in bodies)
        yield f"pcapng_{name}", any_file + file
        yield f"pcapng_{name}_cut", any_file + file[:-30]
        described = b"".join(bytes([0 if kind == 1 else 2, len(body), 0]) + body for kind, body in bodies[:4])
        yield f"blocks_{name}", any_blocks + bytes([order == ">"]) + described
    two = bytes([9]) + struct.pack("<I", 5) + bytes([3, 0x23, 1]) + b"abc" + bytes([0]) + struct.pack("<q", 10**18) + bytes([2, 1, 0]) + b"xy"
    yield "packets_can", packets + bytes([200, 0, 0]) + two
    yield "packets_serial", packets + bytes([200, 0, 1]) + two


def session():
    hello, run, stop, retry = bytes([6, 1, 0, 1]), bytes([6, 2, 4]), bytes([6, 3, 6]), bytes([4, 0, 0])
    other = bytes([6, 1, 2, 9])
    yield "agreement", bytes([1]) + run + hello + run + retry + stop + retry + other + run
    for table, columns in enumerate((5, 4, 7)):
        upload = bytes([3, table, 2]) + bytes(3 * columns)
        apply = bytes([5, 2, 0, table, 3, 1, 0])
        yield f"table_{table + 1}", bytes([1]) + hello + upload + apply + retry + bytes([0, table, 0, 1, 11]) + apply
    yield "no_tables", bytes([0]) + hello + bytes([5, 2, 0, 0, 0, 1, 0])
    trigger = lambda token, number: bytes([6, token, 7, 0, number, 0, 1, 2, 3, 4])
    yield "triggers", bytes([0]) + trigger(1, 0) + hello + trigger(2, 2) + retry + trigger(3, 1) + trigger(3, 0)


def network_camera():
    # Sender, pause, kind (number of words above, 1 below), flags, code; then place and step, or a value, by turns.
    def command(sender, pause, code, *words):
        body = b"".join(bytes([word[0], 0, word[1]]) if isinstance(word, tuple) else struct.pack(">I", word) for word in words)
        return bytes([sender, 0, pause, len(words) << 4 | 1, 1, code, 0]) + body

    control, stream_port, stream_address = (0, 0), (1, 0), (1, 6)
    take, start = command(0, 0, 3, control, 2), command(0, 0, 3, (4, 0), 1)
    stream = command(0, 0, 3, stream_port, 1234) + command(0, 0, 3, stream_address, 0x0A000007)
    yield "stream", take + stream + start + command(0, 0, 1, 1, 2, 3) + command(1, 0, 3, (3, 2), 5)
    yield "silence", take + stream + start + command(1, 200, 3, control, 2) + command(0, 0, 3, (3, 2), 5)
    yield "size", take + stream + command(0, 0, 3, (1, 1), 0xC0000000 + 1400) + command(0, 0, 5, (3, 2), 8)
    yield "read", command(1, 0, 0) + command(1, 0, 4, (3, 0), 64) + command(2, 0, 2, (3, 0)) + command(0, 0, 6, (6, 0), 0, (6, 0))


def layer():
    # Tile 0 at +45 deg; places 24 bits each, G, colour, motions, parallax.
    def record(g, motion=0):
        return (1 << 23).to_bytes(3, "little") * 2 + struct.pack("<HhhhH", g, 800, motion, motion, 500)

    any_file, damaged, stars = bytes([0]), bytes([1]), bytes([3])
    header = b"STARLAY1" + struct.pack("<IIQdffIIf", 2, 6, 0, 2016.0, 10.0, 14.0, 0, 0, 0.0) + bytes(12)
    yield "magic", any_file + header[:20]
    yield "header", any_file + header + bytes(40)
    yield "other", any_file + b"STARCAT1" + bytes(8)
    two = bytes([5]) + b"names" + bytes([2]) + struct.pack("<HB", 0, 1) + record(12000) + record(9000, 30000)
    two += struct.pack("<HB", 49151, 0) + record(15000, -32768)
    yield "whole", damaged + bytes([0]) + two
    for repairs in range(4):
        name = ("repaired", "head_repaired", "tiles_repaired", "as_it_is")[repairs]
        changes = {"header": bytes([1, 1]) + struct.pack("<H", 24) + b"abcd", "table": bytes([1, 2]) + struct.pack("<HQ", 1, 7),
                   "record": bytes([1, 4]) + struct.pack("<H", 12) + b"zz", "length": bytes([1, 5]) + struct.pack("<HB", 9000, 3)}
        for what, change in changes.items():
            yield f"{what}_{name}", damaged + bytes([repairs]) + two + change
    star = lambda flags, *shares: bytes([flags]) + struct.pack("<5H", *shares)
    yield "stars", stars + star(0, 1, 2, 30000, 32768, 32768) * 2 + star(28, 60000, 65535, 60000, 0, 0) + star(0, 65535, 0, 9, 9, 9)
    yield "stars_odd", stars + star(3, 1, 2, 3, 4, 5) + bytes(4) + star(192, 1, 2, 3, 4, 5)


HIP2 = (b" 91262   1 0 1  4.8735545728  0.6768909262  130.23   200.94   286.23   0.26   0.28   0.36   0.32   0.40  98 -0.14  0    1.8"
        b"    0  0.0868 0.0021 0.014 2 -0.001 0.005 -0.010\n")
TYC2 = (b"0001 00017 1|P|  0.05059802|  1.77144349|   32.1|  -20.7| 21| 31| 1.6| 1.6|1989.29|1985.38| 5|1.4|0.6|1.4|0.6|11.318|0.070|"
        b"10.521|0.051| 18|T|         |  0.05086583|  1.77151389|1.78|1.55| 30.0| 45.6|D|-0.2\n")
SUPPLEMENT = (b"3105 02070 1|H|279.23410832|+38.78299311|  201.0|  287.5|  0.5|  0.5|  0.6|  0.6|H|      |     | 0.087|0.002|999| "
              b"| 91262 \n")


def star_lines():
    def head(kind, form=0, place=0, length=255):
        return bytes([kind, form, length]) + struct.pack("<H", place)

    names = b"# %ECSV 1.0\n# ---\nsource_id,ra,dec,parallax,pmra,pmdec,phot_g_mean_mag,phot_bp_mean_mag,phot_rp_mean_mag,bp_rp\r\n"
    bulk = b"4295806720,44.9,0.005,0.35,11.9,-3.4,17.6,18.1,16.9,1.2\n3,45.0,0.02,null,null,null,8.5,null,null,null\n"
    rows = b"5,1.0,2.0,1.5,-2.5,,15.0,1.0,,\n\"6\",3.0,nan,,,,12.0,,,\n# note\n7,3.0,-80,,,,null,,15.5,14.5\n8,3.0,1,,,,19.5,,,\n"
    others = b"5,1.0,2.0,,,,15.0,15.5,14.5\n6,359.9,-89.9,1,2,3,6.0,,"
    yield "bulk", head(0) + names + bulk
    yield "bulk_cut", head(0, 0, 0, 3) + names + bulk[:-20]
    yield "rows", head(1) + rows
    yield "rows_other_names", head(1, 1) + others
    yield "packed", head(2, 0, 0, 0) + rows
    yield "packed_flipped", head(2, 0, 60, 4) + rows
    yield "packed_cut", head(2, 0, 90, 255) + rows
    yield "any_packed", head(3) + gzip.compress(names + bulk, mtime=0)
    for name, text in (("hip2", HIP2), ("tyc2", TYC2), ("supplement", SUPPLEMENT)):
        yield name, head(4) + text * 2
    vega = b"9,279.234734,38.783689,200,286,130,0.03,0,,\n"
    yield "merged_hip2", head(5, 0, len(vega)) + vega + HIP2 + HIP2.replace(b" 91262", b" 91263")
    yield "merged_tyc2", head(5, 0, 0) + TYC2 * 2


def elements():
    def head(kind, norad_id=5, hours=0.0):
        return bytes([kind]) + struct.pack("<fI", hours, norad_id)

    first = b"1 00005U 58002B   00179.78495062  .00000023  00000-0  28098-4 0  4753\n"
    second = b"2 00005  34.2682 348.7242 1859667 331.7664  19.3264 10.82419157413667\n"
    pair = first + second
    yield "pair", head(0) + pair
    yield "titled", head(0) + b"VANGUARD 1\r\n" + pair.replace(b"\n", b"\r\n")
    yield "damaged", head(0) + b"x" + pair[1:] + pair
    yield "many", head(0, 1) + b"A\n" + pair + b"B\n" + pair.replace(b"00005", b"00001")
    resonant = (b"1 08195U 75081A   06176.33215444  .00000099  00000-0  11873-3 0   813\n"
                b"2 08195  64.1586 279.0717 6877146 264.7651  20.2257  2.00491383225656\n")
    yield "resonant", head(0, 8195, 1e6) + resonant
    # Pairs less one; flags; of each line how many changes, place and five characters of each.
    yield "changed", head(1) + bytes([0, 0, 1, 18]) + b"99365" + bytes([2, 52]) + b" 2.00" + bytes([26]) + b"70000"
    yield "alpha_5", head(1, 100_001) + bytes([1, 0, 1, 2]) + b"A0001" + bytes([1, 2]) + b"A0001" + bytes([4, 0, 0, 5]) + b"TITLE"
    message = (b'{"OBJECT_NAME": "ISS", "OBJECT_ID": "1998-067A", "EPOCH": "2008-09-20T12:25:40.104192", "MEAN_MOTION": 15.72125391, '
               b'"ECCENTRICITY": 0.0006703, "INCLINATION": "51.6416", "RA_OF_ASC_NODE": 247.4627, "ARG_OF_PERICENTER": 130.5360, '
               b'"MEAN_ANOMALY": 325.0288, "EPHEMERIS_TYPE": 0, "CLASSIFICATION_TYPE": "U", "NORAD_CAT_ID": 25544, '
               b'"ELEMENT_SET_NO": 292, "REV_AT_EPOCH": 56353, "BSTAR": -0.000011606, "MEAN_MOTION_DOT": -0.00002182, '
               b'"MEAN_MOTION_DDOT": 0, "REF_FRAME": "TEME"}')
    yield "message", head(2) + message
    yield "message_cut", head(2) + message[:300]
    yield "messages", head(2, 123_456_789) + b"[" + message + b", " + message.replace(b"25544", b'"123456789"') + b"]"
    epoch = b'"-2008-09-20T12:25:40.104192"'
    yield "values", head(3) + bytes([0, 2, 2, len(epoch)]) + epoch + bytes([3, 7]) + b"2.00491"
    yield "values_of_two", head(3, 7) + bytes([1, 1, 11, 1]) + b"7" + bytes([1, 4, 3]) + b"0.7"


def plain():
    # Form, meaning of time, sense, fields beyond the usual ones; angle and rate of the good message.
    head = lambda form, fields=b"": bytes([form, 0, 0, len(fields)]) + fields + bytes([0, 4, 1, 0])
    numbers = (1.5, 1.0, 0.0, 0.0, 0.0, 0.01, -0.02, 0.03)
    yield "little", head(0) + struct.pack("<8d", *numbers)
    yield "big", head(1) + struct.pack(">8d", *numbers)
    yield "json", head(2) + b'{"t":1.5,"q":[1,0,0,0],"w_x":0.01,"w_y":-2e-2,"w_z":0}'
    yield "array", head(2) + json.dumps(numbers).encode()
    yield "text", head(3) + b"1.5, 1 0 0 0; 0.01 -0.02 0.03\n"
    yield "jitter", head(0, bytes([0, 14, 13, 12, 20])) + struct.pack("<5d", 1, 2, 3, 4, 5)
    yield "lines", head(4) + (b"TIME 2025-079-12:00:00.010000000\nSC[0].qn = [ 0.0 0.0 0.0 1.0]\nSC[0].wn = [ 0 0 0]\n"
                              b"SC[0].PosR = [1 2 3]\nOrb[0].PosN = [7e6 0 0]\nOrb[0].VelN = [0 7e3 0]\n[ENDMSG]\n")


def jitter_table():
    yield "series", b"\0# shaker\nt_s,x_arcsec,y_urad\n0.0,1.5,-2\n0.1,1e-3,4 # later\n0.2,0,0\n"
    yield "series_ms", b"\0t_ms,z_deg\n0,9\n1,-9\n2,11\n"
    yield "series_steps", b"\0time_s,x_mas\n0,1\n1,2\n2.4,3\n"
    yield "density", b"\1frequency_hz,x_arcsec2_hz,y_rad2_hz\n1,2,0\n10,1e-3,1e-12\n1e4,0,0\n"
    yield "density_falling", b"\1f_hz,x_deg2_hz\n2,1\n1,1\n"


def histories():
    metadata = b"META_START\nOBJECT_NAME = S\nOBJECT_ID = 1\n%sTIME_SYSTEM = UTC\nSTART_TIME = 2026-03-01T00:00:00\nSTOP_TIME = 2026-060T00:01:00\n"
    frames = b"REF_FRAME_A = EME2000\nREF_FRAME_B = SC_BODY_1\n"
    aem = b"CCSDS_AEM_VERS = %s\n" + metadata % frames + b"ATTITUDE_TYPE = QUATERNION%sMETA_STOP\nDATA_START\n%sDATA_STOP\n"
    two = b"2026-03-01T00:00:00 0 0 0 1%s\n2026-03-01T00:00:10.5 0 0.6 0 0.8%s\n"
    rates = two % (b" 1 2 3", b" 0 0 1")
    first = b"\nATTITUDE_DIR = B2A\nQUATERNION_TYPE = FIRST\n"
    yield "aem_1", b"\0" + aem.replace(b"QUATERNION%s", b"QUATERNION" + first) % (b"1.0", two.replace(b"0 0 0 1", b"1 0 0 0") % (b"", b""))
    yield "aem_2", b"\0" + aem % (b"2.0", b"/ANGVEL\nANGVEL_FRAME = SC_BODY_1\n", rates)
    lagrange = b"\nINTERPOLATION_METHOD = LAGRANGE\nINTERPOLATION_DEGREE = 5\nUSEABLE_START_TIME = 2026-03-01T00:00:05\n"
    yield "aem_lagrange", b"\0" + aem % (b"2.0", lagrange, two % (b"", b""))
    for name, kind, rows in (
        ("euler", b"EULER_ANGLE\nEULER_ROT_SEQ = ZXZ\n", (b"30 40 50", b"31 41 51")),
        ("euler_rates", b"EULER_ANGLE/DERIVATIVE\nEULER_ROT_SEQ = XYZ\n", (b"30 40 50 1 2 3", b"40 60 80 1 2 3")),
        ("spin", b"SPIN\n", (b"20 30 10 6", b"20 30 73 6")),
        ("nutation", b"SPIN/NUTATION_MOM\n", (b"20 30 10 6 21 31 4", b"20 30 73 6 21 31 4")),
    ):
        text = two.replace(b"0 0 0 1", rows[0]).replace(b"0 0.6 0 0.8", rows[1]) % (b"", b"")
        yield f"aem_{name}", b"\0" + aem.replace(b"QUATERNION%s", kind) % (b"2.0", text)
    xml = (b'<aem version="2.0"><body><segment><metadata><REF_FRAME_A>ICRF</REF_FRAME_A><REF_FRAME_B>SC_BODY_1</REF_FRAME_B>'
           b"<TIME_SYSTEM>TDB</TIME_SYSTEM><START_TIME>2026-03-01T00:00:00</START_TIME><STOP_TIME>2026-03-01T00:01:00</STOP_TIME>"
           b"<ATTITUDE_TYPE>QUATERNION</ATTITUDE_TYPE></metadata><data><attitudeState><quaternionEphemeris><EPOCH>2026-03-01T00:00:01"
           b"</EPOCH><quaternion><QC>1</QC><Q1>0</Q1><Q2>0</Q2><Q3>0</Q3></quaternion></quaternionEphemeris></attitudeState></data>"
           b"</segment></body></aem>")
    yield "aem_xml", b"\0" + xml
    stk = b"stk.v.11.0\nBEGIN %s\nScenarioEpoch 1 Mar 2026 00:00:00.0\n%s\nEND %s\n"
    yield "stk_a", b"\0" + stk % (b"Attitude", b"CoordinateAxes J2000\nAttitudeTimeQuatAngVels\n0 0 0 0 1 1 2 3\n1 0 0 0 1 1 2 3", b"Attitude")
    yield "stk_e", b"\1" + stk % (b"Ephemeris", b"CoordinateSystem ICRF\nEphemerisTimePosVel\n0 7e6 0 0 0 7e3 0\n9 7e6 6e4 0 0 7e3 0", b"Ephemeris")
    yield "table", b"\0# sense: icrf_from_body\nutc,q1,q2,q3,q4,w_x_deg_s,w_y_deg_s,w_z_deg_s,segment\n2026-03-01T00:00:00Z,0,0,0,1,1,2,3,1\n"
    yield "rows", b"\0# rows\n0 1 0 0 0\n1.5,0.6,0.8,0,0 # later\n"
    orbit = b"CENTER_NAME = MOON\nREF_FRAME = GCRF\n"
    states = b"2026-03-01T00:00:00 2000 0 0 0 1 0\n2026-03-01T00:00:10 2000 10 0 0 1 0\n"
    yield "oem", b"\1CCSDS_OEM_VERS = 2.0\n" + metadata % orbit + b"META_STOP\n" + states + b"COVARIANCE_START\n1\nCOVARIANCE_STOP\n"
    yield "orbit", b"\1# centre: SUN\ntai_ns;x_m;y_m;z_m;vx_m_s;vy_m_s;vz_m_s\n1;2;3;4;5;6;7\n2;2;3;4;5;6;7\n"
    yield "made_table", b"\2" + bytes([2, 0, 2, 1, 1, 1, 3, 1, 1, 2, 1, 0, 1, 1, 1, 2])
    yield "made_message", b"\3" + bytes([2, 0, 2, 1, 1, 1, 3, 1, 1, 2, 1, 0, 1, 1, 1, 2])


def spice():
    def kernel(name, summary, words):
        head = f"{name:<8}".encode() + struct.pack("<ii", 2, 6) + bytes(60) + struct.pack("<iii", 2, 2, 400) + b"LTL-IEEE"
        doubles, integers = summary
        begin = 3 * 128 + 1
        list_ = struct.pack("<ddd", 0, 0, 1) + struct.pack("<dd6i", *doubles, *integers, begin, begin + len(words) - 1)
        return head.ljust(1024, b"\0") + list_.ljust(2048, b"\0") + struct.pack(f"<{len(words)}d", *words)

    rows = [1, 0, 0, 0, 0.8, 0, 0, -0.6, 0, 0, 0, 1]
    yield "ck_3", b"\0" + kernel("DAF/CK", ((0, 200), (-7, 1, 3, 0)), rows + [0, 100, 200, 0, 1, 3])
    yield "ck_2", b"\0" + kernel("DAF/CK", ((0, 200), (-7, 1, 2, 1)), [1, 0, 0, 0, 0, 0, 0.1, 0.01, 0, 200])
    states = [7000, 0, 0, 7, 0, 0, 7070, 0, 0, 7, 0, 0, 7140, 0, 0, 7, 0, 0]
    for kind, window in ((9, 2), (13, 1)):
        yield f"spk_{kind}", b"\1" + kernel("DAF/SPK", ((0, 20), (-7, 399, 1, kind)), states + [0, 10, 20, window, 3])
    yield "spk_2", b"\1" + kernel("DAF/SPK", ((0, 100), (-7, 399, 1, 2)), [50, 50, 7000, 350, 0, 0, 0, 0, 0, 100, 8, 1])
    yield "text", b"\2KPL/LSK\n\\begindata\nDELTET/K = 1.657D-3\nA += ( 'x' @2026-JAN-1\n 5 )\n\\begintext\n"


def tracker_commands():
    def crc16(data):
        crc = 0xFFFF
        for byte in data:
            crc ^= byte << 8
            for _ in range(8):
                crc = (crc << 1 ^ 0x1021 if crc & 0x8000 else crc << 1) & 0xFFFF
        return data + struct.pack(">H", crc)

    def telecommand(service, subtype, data=b""):
        return crc16(struct.pack(">HHHBBBH", 0x1864, 0xC001, 6 + len(data), 0x29, service, subtype, 5) + data)

    head = bytes([2, 0, 7, 30])
    lines = [b'{"command": "%s"}\n' % name for name in (b"ping", b"operate", b"standby", b"reset", b"dance")]
    yield "json", b"\0" + head + b"".join(lines) + b'{"command": "exposure", "exposure_ms": 40}\nhello\n'
    nos3 = [b"\xde\xad" + struct.pack(">BI", code, payload) + b"\xbe\xef" for code, payload in
            ((0, 0), (1, 0), (2, 0), (3, 0), (3, 1), (3, 20000), (9, 9))]
    yield "nos3", b"\1" + head + b"".join(nos3)
    # The published frame to boot, and frames with hashes by PyPI xxhash: solution, camera, subscription.
    frames = ["c0210301019c349a61c0",
              "c0210218ac15e176c0",
              "c02101095b0dc8dbddc0",
              "c02100121b000000000000000000000000000000579bd4c4c0"]
    yield "sagitta", b"\2" + head + b"".join(map(bytes.fromhex, frames))
    packets = [telecommand(17, 1), telecommand(3, 27, b"\0\1\0\1"), telecommand(8, 1, b"\1\0"), telecommand(8, 1, b"\3"),
               telecommand(8, 1, b"\2" + struct.pack(">I", 20000)), telecommand(99, 1)]
    yield "ccsds", b"\3" + head + b"\xff".join(packets)
    sdo = [struct.pack("<H", 8 << 12) + bytes(data) for data in
           ((0x40, 0x17, 0x10, 0, 0, 0, 0, 0), (0x2B, 0x17, 0x10, 0, 100, 0, 0, 0), (0x2F, 0, 0x40, 0, 2, 0, 0, 0),
            (0x23, 5, 0x40, 0, 0x20, 0x4E, 0, 0), (0x2F, 7, 0x40, 0, 1, 0, 0, 0), (0x2F, 0, 0x18, 2, 1, 0, 0, 0))]
    nmt = [struct.pack("<H", 2 << 12 | 1) + bytes([command, 0]) for command in (1, 2, 128, 129, 130)]
    yield "canopen", b"\4" + head + b"".join(sdo) + struct.pack("<H", 2) + b"".join(nmt)


def tracker_telemetry():
    def crc16(data):
        crc = 0xFFFF
        for byte in data:
            crc ^= byte << 8
            for _ in range(8):
                crc = (crc << 1 ^ 0x1021 if crc & 0x8000 else crc << 1) & 0xFFFF
        return data + struct.pack(">H", crc)

    head = bytes([2, 0, 7, 30])
    halves = struct.pack(">4H", 16385, 49151, 49151, 49151)
    nos3 = b"\xde\xad\x02\0\0\0\0\xbe\xef\xde\xad" + halves
    yield "nos3", b"\0" + head + nos3 + b"\1\xbe\xef" + b"\x55" + nos3 + b"\0\xbe\xef"
    # Two frames of the right form with wrong hashes: damage.
    solutions = [
        "c0218418000000000090e3f9c0f54b06000a4f7e3f5d89cb3d00000000000000000000803f0a4f7e3f5d89cb3d0000000000000000001515c0",
        "c021841b00c0",
    ]
    yield "sagitta", b"\1" + head + b"".join(map(bytes.fromhex, solutions))
    time = b"\x1f" + struct.pack(">I", 2_150_000_000) + b"\x40\0\0"
    for valid in (0, 1):
        data = struct.pack(">H", 1) + time + bytes([2, valid]) + struct.pack(">IH4d8f", 7, 21, 0.5, -0.5, 0.5, 0.5, *[0.0] * 8)
        packet = struct.pack(">HHHBBBHH", 0x0864, 0xC000, 7 + 8 + len(data) + 2 - 1, 0x20, 3, 25, 0, 0) + time + data
        yield f"ccsds_{valid}", b"\2" + head + b"\xff" + crc16(packet)

    def pdo(number, data):
        return struct.pack("<H", 8 << 12 | number) + data

    halves = struct.pack("<2f", 0.5, 0.5)
    first = [struct.pack("<BBHI", 4, known, 21, 43_200_250) for known in (1, 0)]
    yield "canopen", b"\3" + head + pdo(0, first[0]) + pdo(1, halves) + pdo(2, halves) + pdo(0, first[1]) + pdo(2, halves)
    lines = [b'{"frame": 7, "tai_ns": 1772366437150000000, "q_wxyz": [0.5, 0.5, 0.5, 0.5]}', b'{"q_wxyz": null}', b'{"reply": 1}', b"{]"]
    yield "json", b"\4" + head + b"\n".join(lines) + b"\n"


for target in (can_decode, serial_resync, slcan, socketcand, captures, plain, network_camera, session, layer, star_lines,
               elements, jitter_table, histories, spice, tracker_commands, tracker_telemetry):
    folder = HERE / "corpus" / target.__name__
    folder.mkdir(parents=True, exist_ok=True)
    for name, seed in target():
        (folder / name).write_bytes(seed)
