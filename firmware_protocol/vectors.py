#!/usr/bin/env python3
"""Byte-exact test vectors of the wire protocol: python3 firmware_protocol/vectors.py > firmware_protocol/vectors.json

Written from the byte tables of INTERFACE.md with struct alone, so that it shares nothing with the codecs that are held
to its output. Each vector gives a message by its physical values, and its bytes on CAN FD, on classic CAN (null where
classic CAN does not carry it) and on a serial line with the packet's sequence number. An identifier of 11 bits has 3
digits, one of 29 bits 8. The vectors under "rejected" give the input, in order, and the reason for which its last piece
is refused; what comes before is accepted.
"""

import json
import math
import struct

MAJOR, MINOR = 1, 4
REJECTS = ["NotFinite", "QuaternionNorm", "BadCrc", "WrongLength", "TornGroup", "UnknownId", "UnknownValue",
           "WrongVersion", "ReplayedSequence", "StaleTime", "FutureTime", "BadFraming", "Oversize"]
NUMBERS = {"SYNC": 0x08, "EXPOSURE": 0x18, "STATUS": 0x19, "CAMERA_STATUS": 0x1A, "TIME_FUP": 0x20, "ATT_Q01": 0x21, "ATT_Q23": 0x22,
           "ATT_W": 0x23, "ATT_A": 0x24, "ATT_T": 0x25, "WHEELS": 0x28, "JITTER": 0x2A, "ATT_FD": 0x30,
           "JITTER_FD": 0x31, "TABLE": 0x48, "RSP": 0x58, "CMD": 0x60, "HEARTBEAT": 0x70}


def crc16(data):
    """CRC-16/IBM-3740, bit by bit."""
    crc = 0xFFFF
    for byte in data:
        crc ^= byte << 8
        for _ in range(8):
            crc = (crc << 1 ^ 0x1021 if crc & 0x8000 else crc << 1) & 0xFFFF
    return crc


def cobs(plain):
    """Each run between zeros with its length + 1 before it. No packet is long enough for a run of 254."""
    runs = plain.split(b"\0")
    assert all(len(run) < 254 for run in runs)
    return b"".join(bytes([len(run) + 1]) + run for run in runs)


def counts(value, lsb):
    """Nearest count, halves away from zero, of the value as f32."""
    exact = struct.unpack("<f", struct.pack("<f", value))[0] / lsb
    return int(math.copysign(math.floor(abs(exact) + 0.5), exact))


def packed(values, lsb, bits, shift=0):
    """Two's complement fields from bit `shift` of a 64-bit word upwards."""
    word = 0
    for i, value in enumerate(values):
        word |= (counts(value, lsb) & (1 << bits) - 1) << shift + bits * i
    return word


def attitude_flags(f):
    return f["rate_valid"] | f["acceleration_valid"] << 1


def attitude(f):
    head = struct.pack("<IBB", f["t_us"], f["seq"], attitude_flags(f))
    values = struct.pack("<10f", *f["q_wxyz"], *f["rate_rad_s"], *f["acceleration_rad_s2"])
    return head + struct.pack("<H", crc16(head + values)) + values


def attitude_group(f):
    parts = [("ATT_Q01", struct.pack("<2f", *f["q_wxyz"][:2])), ("ATT_Q23", struct.pack("<2f", *f["q_wxyz"][2:]))]
    if f["rate_valid"]:
        parts.append(("ATT_W", struct.pack("<Q", packed(f["rate_rad_s"], 1e-6, 21))))
    if f["acceleration_valid"]:
        parts.append(("ATT_A", struct.pack("<Q", packed(f["acceleration_rad_s2"], 1e-6, 21))))
    head = struct.pack("<IBB", f["t_us"], f["seq"], attitude_flags(f))
    crc = crc16(b"".join(data for _, data in parts) + head)
    return [*parts, ("ATT_T", head + struct.pack("<H", crc))]


def jitter_fd(f):
    samples = [counts(value, 0.01) for sample in f["samples_arcsec"] for value in sample]
    head = struct.pack("<IHBB", f["t_first_us"], f["period_us"], f["seq"], len(f["samples_arcsec"]))
    return head + struct.pack("<28h", *samples, *[0] * (28 - len(samples)))


def jitter(f):
    flat = [value for sample in f["samples_arcsec"] for value in sample]
    return struct.pack("<Q", packed(flat, 0.02, 14, 8) | f["slot"])


def status(f):
    page = f["page"]
    if page == 0:
        return struct.pack("<BBHI", 0, f["mode"], f["frames"], f["latency_us"])
    if page == 1:
        return struct.pack("<BBhf", 1, 0, f["horizon_10us"], f["error_arcsec"])
    if page == 2:
        return struct.pack("<BBhi", 2, 0, f["drift_0_1ppm"], f["residual_ns"])
    if page == 3:
        return struct.pack("<BBHI", 3, f["reason"], 0, f["count"])
    return struct.pack("<BBHI", page, f["frame"], f["flags"], f["turns_2_32"])


def camera_status(f):
    head = struct.pack("<BBB", f["page"], f["head"], f["frame"])
    if f["page"] == 0:
        return head + struct.pack("<BI", f["started_by"], f["exposure_us"])
    if f["page"] == 1:
        return head + struct.pack("<H", f["gain_cdb"]) + struct.pack("<I", f["black_level_dn_16"])[:3]
    return head + struct.pack("<BI", 0, f["delay_us"])


def command(f):
    arguments = {1: lambda: struct.pack("<BBI", f["major"], f["minor"], 0),
                 2: lambda: struct.pack("<B5x", f["page"]),
                 5: lambda: struct.pack("<BBHH", f["table"], f["rows"], f["crc16"], f["seed"]),
                 6: lambda: struct.pack("<HI", f["trigger"], f["at_us"]),
                 7: lambda: struct.pack("<BBI", f["camera_kind"], f["head"], f["camera_value"]),
                 8: lambda: struct.pack("<BBI", f["head"], 0, f["at_us"])}
    return bytes([f["opcode"], f["token"]]) + arguments.get(f["opcode"], lambda: bytes(6))()


def response(f):
    results = {1: lambda: struct.pack("<BBHB", f["major"], f["minor"], f["capabilities"], f["attitude_convention"]),
               2: lambda: (struct.pack("<BI", 0, f["dbc_crc32"]) if f["page"] == 0
                           else struct.pack("<BHH", 1, f["attitude_hz"], f["jitter_hz"])),
               5: lambda: struct.pack("<BB3x", f["table"], f["rows"]),
               6: lambda: struct.pack("<HB2x", f["trigger"], f["late"]),
               7: lambda: struct.pack("<BB3x", f["camera_kind"], f["head"]),
               8: lambda: struct.pack("<BB3x", f["head"], f["late"])}
    done = results.get(f["opcode"], lambda: bytes(5)) if f["code"] == 0 else lambda: bytes(5)
    return bytes([f["opcode"], f["token"], f["code"]]) + done()


PAYLOADS = {
    "SYNC": lambda f: struct.pack("<B", f["counter"]),
    "TIME_FUP": lambda f: struct.pack("<II", f["seconds"], f["fraction_2_24"])[:7] + bytes([f["counter"]]),
    "EXPOSURE": lambda f: struct.pack("<BBIH", f["frame"], f["attitude_seq"], f["mid_exposure_us"], f["age_us"] // 10),
    "STATUS": status,
    "CAMERA_STATUS": camera_status,
    "WHEELS": lambda f: struct.pack("<4h", *[counts(value, 0.25) for value in f["speed_rpm"]]),
    "JITTER": jitter,
    "ATT_FD": attitude,
    "JITTER_FD": jitter_fd,
    "TABLE": lambda f: struct.pack("<BBBBf", f["table"], f["row"], f["column"], 0, f["value"]),
    "RSP": response,
    "CMD": command,
    "HEARTBEAT": lambda f: struct.pack("<BB", f["state"], f["major"]),
}


def identifier(name, base, node):
    return base + (NUMBERS[name] << 4 | (0 if name == "SYNC" else node))


def frame(name, data, base=0, node=0, id_bits=11):
    digits = {11: 3, 29: 8}[id_bits]
    return {"id": f"{identifier(name, base, node):0{digits}X}", "data": data.hex()}


def line(number, seq, payload, major=MAJOR):
    packet = bytes([major, number, seq, len(payload)]) + payload
    return cobs(packet + struct.pack("<H", crc16(packet))) + b"\0"


def vector(name, message, seq, fields, base=0, node=0, id_bits=11):
    data, place = PAYLOADS[message](fields), (base, node, id_bits)
    if message == "ATT_FD":
        classic = [frame(part, bytes_, *place) for part, bytes_ in attitude_group(fields)]
    else:
        classic = [frame(message, data, *place)] if len(data) <= 8 else None
    return {"name": name, "message": message, "fields": fields, "id_bits": id_bits, "base": base, "node": node,
            "fd": frame(message, data, *place), "classic": classic,
            "serial": {"seq": seq, "data": line(NUMBERS[message], seq, data).hex()}}


def attitude_fields(**changes):
    s, c = math.sin(0.3), math.cos(0.3)
    return {"t_us": 123456789, "seq": 42, "rate_valid": True, "acceleration_valid": True,
            "q_wxyz": [c, 0.6 * s, 0.0, -0.8 * s], "rate_rad_s": [0.0125, -0.5, 1.0],
            "acceleration_rad_s2": [-0.001, 0.25, 0.0], **changes}


def burst_fields(count, **changes):
    samples = [[round(0.37 * i - 1.5, 2), round(-2.11 * i + 0.04, 2)] for i in range(count)]
    return {"t_first_us": 4294967000, "period_us": 1000, "seq": 255, "samples_arcsec": samples, **changes}


def messages():
    zero3 = [0.0, 0.0, 0.0]
    turns = {4: 0x40000000, 5: 0xE0000000, 6: 0x12345678}
    out = [
        vector("sync", "SYNC", 0, {"counter": 254}),
        vector("sync of another base keeps node 0", "SYNC", 1, {"counter": 0}, 0x40, 5),
        vector("time follow-up", "TIME_FUP", 2, {"seconds": 0x11223344, "fraction_2_24": 0x556677, "counter": 254}),
        vector("time follow-up at the end of a second", "TIME_FUP", 3,
               {"seconds": 4294967295, "fraction_2_24": 16777215, "counter": 255}),
        vector("attitude, whole", "ATT_FD", 4, attitude_fields()),
        vector("attitude of another base and node", "ATT_FD", 5, attitude_fields(seq=43), 0xF0, 15),
        vector("attitude without acceleration", "ATT_FD", 6,
               attitude_fields(t_us=0, seq=0, acceleration_valid=False, acceleration_rad_s2=zero3)),
        vector("attitude without rate", "ATT_FD", 7,
               attitude_fields(t_us=4294967295, seq=255, rate_valid=False, rate_rad_s=zero3)),
        vector("attitude alone, negative scalar", "ATT_FD", 8,
               attitude_fields(rate_valid=False, acceleration_valid=False, q_wxyz=[-1.0, 0.0, 0.0, 0.0],
                               rate_rad_s=zero3, acceleration_rad_s2=zero3)),
        vector("attitude, largest classic rates", "ATT_FD", 9,
               attitude_fields(rate_rad_s=[1.048575, -1.048575, 1e-6], acceleration_rad_s2=[-1e-6, 1.048575, -1.048575])),
        vector("attitude, norm within tolerance", "ATT_FD", 10, attitude_fields(q_wxyz=[1.0009, 0.0, 0.0, 0.0])),
        vector("jitter burst, one sample", "JITTER_FD", 11, burst_fields(1)),
        vector("jitter burst, full", "JITTER_FD", 12, burst_fields(14, seq=0)),
        vector("jitter burst, largest", "JITTER_FD", 13,
               burst_fields(0, samples_arcsec=[[327.67, -327.67], [0.01, -0.01]], period_us=65535, t_first_us=0, seq=7)),
        vector("jitter pair", "JITTER", 14, {"slot": 128, "samples_arcsec": [[1.0, -1.0], [163.82, -163.82]]}),
        vector("jitter pair, smallest steps", "JITTER", 15, {"slot": 0, "samples_arcsec": [[0.02, -0.02], [0.0, 0.04]]}),
        vector("wheels", "WHEELS", 16, {"speed_rpm": [6000.0, -6000.0, 0.25, -8191.75]}),
        vector("exposure", "EXPOSURE", 17, {"frame": 9, "attitude_seq": 42, "mid_exposure_us": 67305985, "age_us": 46600}),
        vector("exposure, longest age", "EXPOSURE", 18,
               {"frame": 255, "attitude_seq": 0, "mid_exposure_us": 4294967295, "age_us": 655350}),
        vector("status: prediction", "STATUS", 19, {"page": 1, "horizon_10us": -300, "error_arcsec": 0.75}),
        vector("status: clock", "STATUS", 20, {"page": 2, "drift_0_1ppm": -25, "residual_ns": -123456}),
    ]
    add = lambda name, message, **fields: out.append(vector(name, message, len(out), fields))
    for mode in range(5):
        add(f"status: state, mode {mode}", "STATUS", page=0, mode=mode, frames=0x1234 + mode, latency_us=0xABCDEF)
    for reason, name in enumerate(REJECTS):
        add(f"status: rejects, {name}", "STATUS", page=3, reason=reason, count=70000 + reason)
    for page, turn in turns.items():
        add(f"status: pointing, page {page}", "STATUS", page=page, frame=200, turns_2_32=turn, flags=0)
    add("hello", "CMD", opcode=1, token=5, major=1, minor=1)
    add("hello of a 1.0 peer", "CMD", opcode=1, token=6, major=1, minor=0)
    add("info", "CMD", opcode=2, token=7, page=1)
    add("run", "CMD", opcode=3, token=8)
    add("stop", "CMD", opcode=4, token=9)
    add("apply", "CMD", opcode=5, token=10, table=2, rows=32, crc16=0xBEEF, seed=0x1234)
    add("apply, clearing", "CMD", opcode=5, token=11, table=3, rows=0, crc16=0, seed=0)
    add("an opcode of a later version", "CMD", opcode=200, token=12)
    add("hello done", "RSP", opcode=1, token=5, code=0, major=1, minor=1, capabilities=7, attitude_convention=1)
    add("DBC checksum", "RSP", opcode=2, token=6, code=0, page=0, dbc_crc32=0xDEADBEEF)
    add("rates", "RSP", opcode=2, token=7, code=0, page=1, attitude_hz=100, jitter_hz=1000)
    add("running", "RSP", opcode=3, token=8, code=0)
    add("stopped", "RSP", opcode=4, token=9, code=0)
    add("applied", "RSP", opcode=5, token=10, code=0, table=2, rows=32)
    for code in range(1, 8):
        add(f"refused, code {code}", "RSP", opcode=5, token=10, code=code)
    add("an unknown opcode refused", "RSP", opcode=200, token=12, code=1)
    for state in range(4):
        add(f"heartbeat, state {state}", "HEARTBEAT", state=state, major=1)
    for table, (rows, columns) in {1: (32, 5), 2: (32, 4), 3: (64, 7)}.items():
        for column in range(columns):
            add(f"cell of table {table}, column {column}", "TABLE", table=table, row=rows - 1, column=column,
                value=1.5 * column - 2.25)
    # Since 1.2; the bytes above are those of 1.1.
    add("hello of a 1.2 peer", "CMD", opcode=1, token=13, major=1, minor=2)
    add("hello done by 1.2", "RSP", opcode=1, token=13, code=0, major=1, minor=2, capabilities=15, attitude_convention=1)
    add("trigger at an instant", "CMD", opcode=6, token=14, trigger=0x1234, at_us=67305985)
    add("trigger at once", "CMD", opcode=6, token=15, trigger=65535, at_us=0)
    add("triggered", "RSP", opcode=6, token=14, code=0, trigger=0x1234, late=0)
    add("triggered late", "RSP", opcode=6, token=15, code=0, trigger=65535, late=1)
    for code in range(8, 11):
        add(f"trigger refused, code {code}", "RSP", opcode=6, token=16, code=code)
    # Since 1.3; the bytes above are those of 1.2.
    add("hello of a 1.3 peer", "CMD", opcode=1, token=17, major=1, minor=3)
    add("hello done by 1.3", "RSP", opcode=1, token=17, code=0, major=1, minor=3, capabilities=15, attitude_convention=1)
    for page, flags in ((4, 1), (5, 2), (6, 3), (6, 0x8000)):
        add(f"status: pointing, page {page}, flags {flags:#x}", "STATUS", page=page, frame=201, turns_2_32=turns[page], flags=flags)
    add("trigger refused, code 11", "RSP", opcode=6, token=18, code=11)
    # Since 1.4; the bytes above are those of 1.3.
    add("hello of a 1.4 peer", "CMD", opcode=1, token=19, major=1, minor=4)
    add("hello done by 1.4", "RSP", opcode=1, token=19, code=0, major=1, minor=4, capabilities=31, attitude_convention=1)
    for kind in range(1, 13):
        add(f"camera, kind {kind}", "CMD", opcode=7, token=20, camera_kind=kind, head=kind, camera_value=0x12345678 + kind)
    add("camera, all heads", "CMD", opcode=7, token=21, camera_kind=1, head=255, camera_value=4294967295)
    add("camera, a kind of a later version", "CMD", opcode=7, token=22, camera_kind=200, head=0, camera_value=0)
    add("camera trigger at an instant", "CMD", opcode=8, token=23, head=1, at_us=67305985)
    add("camera trigger at once, all heads", "CMD", opcode=8, token=24, head=255, at_us=0)
    add("camera set", "RSP", opcode=7, token=20, code=0, camera_kind=2, head=15)
    add("camera triggered", "RSP", opcode=8, token=23, code=0, head=1, late=0)
    add("camera triggered late", "RSP", opcode=8, token=24, code=0, head=255, late=1)
    for code in range(12, 16):
        add(f"camera refused, code {code}", "RSP", opcode=7, token=25, code=code)
    add("camera trigger refused, code 14", "RSP", opcode=8, token=26, code=14)
    for started_by in range(6):
        add(f"camera status: exposure started by {started_by}", "CAMERA_STATUS", page=0, head=started_by, frame=200,
            started_by=started_by, exposure_us=50000 + started_by)
    add("camera status: levels", "CAMERA_STATUS", page=1, head=0, frame=201, gain_cdb=600, black_level_dn_16=1024)
    add("camera status: largest levels", "CAMERA_STATUS", page=1, head=15, frame=255, gain_cdb=65535,
        black_level_dn_16=16777215)
    add("camera status: trigger", "CAMERA_STATUS", page=2, head=0, frame=202, delay_us=0x12345678)
    # Identifiers of 29 bits; the payloads are the same.
    for name, message, fields, base, node in (
            ("sync", "SYNC", {"counter": 254}, 0x18FF0000, 5), ("attitude", "ATT_FD", attitude_fields(), 0x18FF0000, 5),
            ("heartbeat", "HEARTBEAT", {"state": 2, "major": 1}, 0, 0),
            ("heartbeat, highest identifier", "HEARTBEAT", {"state": 2, "major": 1}, 0x1FFFF8F0, 15)):
        out.append(vector(f"29 bits: {name}", message, len(out), fields, base, node, 29))
    return out


def changed(data, at, value):
    return data[:at] + bytes([value]) + data[at + 1:]


def can_rejected():
    """(name, [(message, data)], reason)"""
    whole = attitude_fields()
    fd, group = attitude(whole), attitude_group(whole)
    later = attitude_group(attitude_fields(seq=44, t_us=123476789, q_wxyz=[1.0, 0.0, 0.0, 0.0],
                                           rate_rad_s=[0.5, 0.0, 0.0], acceleration_rad_s2=[0.0, 0.0, 0.5]))
    bad_q = lambda q: attitude_fields(q_wxyz=q)
    burst = jitter_fd(burst_fields(14))
    table = lambda t, row, column, value=1.0: struct.pack("<BBBBf", t, row, column, 0, value)
    yield "sync too long", [("SYNC", b"\1\2")], "WrongLength"
    yield "sync empty", [("SYNC", b"")], "WrongLength"
    yield "command too short", [("CMD", bytes(7))], "WrongLength"
    yield "attitude too long", [("ATT_FD", fd + bytes(16))], "WrongLength"
    yield "group part too short", [("ATT_Q01", bytes(7))], "WrongLength"
    yield "commit too short", [("ATT_T", bytes(7))], "WrongLength"
    for at in (0, 4, 5, 6, 8, 47):
        yield f"attitude, bit of byte {at} flipped", [("ATT_FD", changed(fd, at, fd[at] ^ 1))], "BadCrc"
    for name, value in (("NaN", math.nan), ("infinity", math.inf)):
        yield f"quaternion with {name}", [("ATT_FD", attitude(bad_q([value, 0.0, 0.0, 0.0])))], "NotFinite"
        yield f"group with {name}", attitude_group(bad_q([0.0, 0.0, value, 0.0])), "NotFinite"
        yield f"rate of {name}", [("ATT_FD", attitude(attitude_fields(rate_rad_s=[0.0, value, 0.0])))], "NotFinite"
        yield f"cell of {name}", [("TABLE", table(1, 0, 0, value))], "NotFinite"
        yield f"status with {name}", [("STATUS", struct.pack("<BBhf", 1, 0, 0, value))], "NotFinite"
    for name, q in (("long", [1.0011, 0.0, 0.0, 0.0]), ("short", [0.0, 0.9989, 0.0, 0.0]), ("zero", [0.0] * 4)):
        yield f"quaternion {name}", [("ATT_FD", attitude(bad_q(q)))], "QuaternionNorm"
        yield f"group {name}", attitude_group(bad_q(q)), "QuaternionNorm"
    yield "attitude received twice", [("ATT_FD", fd), ("ATT_FD", fd)], "ReplayedSequence"
    yield "group after its FD form", [("ATT_FD", fd), *group], "ReplayedSequence"
    behind = attitude(attitude_fields(seq=42 - 15))
    yield "attitude 15 behind", [("ATT_FD", fd), ("ATT_FD", behind)], "ReplayedSequence"
    yield "burst received twice", [("JITTER_FD", burst), ("JITTER_FD", burst)], "ReplayedSequence"
    pair = jitter({"slot": 3, "samples_arcsec": [[0.0, 0.0], [0.0, 0.0]]})
    yield "pair received twice", [("JITTER", pair), ("JITTER", pair)], "ReplayedSequence"
    for lost in range(4):
        yield f"group without part {lost}", [part for i, part in enumerate(group) if i != lost], "TornGroup"
        swapped = [later[i] if i == lost else part for i, part in enumerate(group)]
        yield f"group with part {lost} of another epoch", swapped, "TornGroup"
        yield f"part {lost} twice", [group[lost], group[lost]], "TornGroup"
    yield "commit alone", [group[-1]], "TornGroup"
    yield "commit twice", [*group, group[-1]], "TornGroup"
    bare = attitude_group(attitude_fields(rate_valid=False, acceleration_valid=False))
    yield "a rate that the flags deny", [*bare[:2], group[2], bare[-1]], "TornGroup"
    yield "burst without samples", [("JITTER_FD", changed(burst, 7, 0))], "UnknownValue"
    yield "burst of 15", [("JITTER_FD", changed(burst, 7, 15))], "UnknownValue"
    yield "burst without period", [("JITTER_FD", changed(changed(burst, 4, 0), 5, 0))], "UnknownValue"
    lowest = lambda bits, place, shift=0: struct.pack("<Q", 1 << shift + bits * place + bits - 1)
    for place in range(4):
        yield f"wheel {place}, lowest count", [("WHEELS", lowest(16, place))], "UnknownValue"
        yield f"pair, lowest count {place}", [("JITTER", lowest(14, place, 8))], "UnknownValue"
    for place in (0, 27):
        raw = changed(changed(burst, 8 + 2 * place, 0), 9 + 2 * place, 0x80)
        yield f"burst, lowest count {place}", [("JITTER_FD", raw)], "UnknownValue"
    for flags, part in ((1, "ATT_W"), (2, "ATT_A")):
        for place in range(3):
            parts = [*bare[:2], (part, lowest(21, place))]
            head = struct.pack("<IBB", 1, 1, flags)
            crc = crc16(b"".join(data for _, data in parts) + head)
            yield f"{part}, lowest count {place}", [*parts, ("ATT_T", head + struct.pack("<H", crc))], "UnknownValue"
    yield "status page 7", [("STATUS", changed(bytes(8), 0, 7))], "UnknownValue"
    yield "status mode 5", [("STATUS", changed(bytes(8), 1, 5))], "UnknownValue"
    yield "status reason 13", [("STATUS", b"\3\x0d" + bytes(6))], "UnknownValue"
    yield "response of opcode 9", [("RSP", b"\x09" + bytes(7))], "UnknownValue"
    yield "response with code 16", [("RSP", b"\5\0\x10" + bytes(5))], "UnknownValue"
    yield "response with page 2", [("RSP", b"\2\0\0\2" + bytes(4))], "UnknownValue"
    yield "response for table 4", [("RSP", b"\5\0\0\4" + bytes(4))], "UnknownValue"
    yield "camera status page 3", [("CAMERA_STATUS", changed(bytes(8), 0, 3))], "UnknownValue"
    yield "camera status started by 6", [("CAMERA_STATUS", changed(bytes(8), 3, 6))], "UnknownValue"
    yield "heartbeat state 4", [("HEARTBEAT", b"\4\1")], "UnknownValue"
    yield "table 0", [("TABLE", table(0, 0, 0))], "UnknownValue"
    yield "table 4", [("TABLE", table(4, 0, 0))], "UnknownValue"
    for number, (rows, columns) in {1: (32, 5), 2: (32, 4), 3: (64, 7)}.items():
        yield f"table {number}, row too high", [("TABLE", table(number, rows, 0))], "UnknownValue"
        yield f"table {number}, column too high", [("TABLE", table(number, 0, columns))], "UnknownValue"


def serial_rejected():
    """(name, bytes, reason)"""
    good = line(0x08, 0, b"\xfe")
    packet = bytes([1, 0x08, 0, 1, 0xFE])
    sealed = lambda body: cobs(body + struct.pack("<H", crc16(body))) + b"\0"
    yield "a byte changed", changed(good, 6, good[6] ^ 0x10), "BadCrc"
    yield "CRC of another start", cobs(packet + b"\0\0") + b"\0", "BadCrc"
    yield "run beyond the packet", changed(good, 0, 0x20), "BadFraming"
    yield "shorter than a header", b"\2\1\0", "WrongLength"
    yield "a byte missing", sealed(packet[:-1]), "WrongLength"
    yield "a byte too many", sealed(packet + b"\0"), "WrongLength"
    yield "no delimiter in 72 bytes", b"\1" * 72 + b"\0", "Oversize"
    yield "another major version", line(0x08, 0, b"\xfe", major=2), "WrongVersion"
    yield "an unknown type", line(0x09, 0, b"\xfe"), "UnknownId"
    yield "a part of the classic group", line(0x21, 0, bytes(8)), "UnknownId"
    yield "payload of another length", line(0x08, 0, b"\1\2"), "WrongLength"
    fd = attitude(attitude_fields())
    yield "attitude with its own CRC wrong", line(0x30, 0, changed(fd, 6, fd[6] ^ 1)), "BadCrc"
    yield "attitude received twice", line(0x30, 0, fd) + line(0x30, 1, fd), "ReplayedSequence"


def rejected():
    out = []
    for name, frames, reason in can_rejected():
        out.append({"name": name, "frames": [frame(message, data) for message, data in frames], "reason": reason})
    for name, id_, reason in (("an unknown identifier", "7FF", "UnknownId"), ("another node", "201", "UnknownId"),
                              ("sync of another node", "081", "UnknownId"),
                              ("the number of a heartbeat, with 29 bits", "00000700", "UnknownId")):
        out.append({"name": name, "frames": [{"id": id_, "data": bytes(8).hex()}], "reason": reason})
    for name, data, reason in serial_rejected():
        out.append({"name": name, "serial": data.hex(), "reason": reason})
    return out


def main():
    assert crc16(b"123456789") == 0x29B1
    document = {"version": {"major": MAJOR, "minor": MINOR}, "messages": messages(), "rejected": rejected()}
    blocks = [f' "version": {json.dumps(document["version"])}']
    for key in ("messages", "rejected"):
        blocks.append(f' "{key}": [\n  ' + ",\n  ".join(json.dumps(entry) for entry in document[key]) + "\n ]")
    print("{\n" + ",\n".join(blocks) + "\n}")


if __name__ == "__main__":
    main()
