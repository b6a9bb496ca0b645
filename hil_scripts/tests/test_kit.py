"""The firmware kit in Python: cantools with the DBC against the byte-exact vectors: python3 hil_scripts/tests/test_kit.py

Needs cantools (hil_scripts/requirements_flight_computer.txt). Both directions, CAN FD and classic CAN, every page, opcode and table.
"""

import json
import re
import struct
import subprocess
import sys
import unittest

import cantools

from support import ROOT
from starloop.shared_frames import FILE_HEAD, SLOT_HEAD, SLOT_NAMES
from starloop.wire import REFUSALS, Codec

KIT = ROOT / "firmware_protocol"
VECTORS = json.loads((KIT / "vectors.json").read_text())
# Half of 1e-6 rad/s, and the rounding of f32.
CLASSIC_RATE_RAD_S = 0.51e-6
# Rounding of f32 and of f64, relative.
F32, F64 = 1.2e-7, 1e-12

LINE = ["Frequency", "AmplitudeX", "AmplitudeY", "AmplitudeZ", "Phase"]
PSD = ["Frequency", "DensityX", "DensityY", "DensityZ"]
HARMONIC = ["Wheel", "Number", "AmplitudeX", "AmplitudeY", "AmplitudeZ", "Exponent", "Phase"]
TABLES = {1: ("Line", LINE), 2: ("Psd", PSD), 3: ("Harmonic", HARMONIC)}


def database():
    return cantools.database.load_file(KIT / "dbc/starloop.dbc")


def f32(value):
    return struct.unpack("<f", struct.pack("<f", value))[0]


def xyz(name, values):
    return {name + axis: value for axis, value in zip("XYZ", values)}


def attitude(fields, crc16):
    head = {"TimeTag": fields["t_us"], "Seq": fields["seq"], "RateValid": int(fields["rate_valid"]),
            "AccelerationValid": int(fields["acceleration_valid"]), "Crc16": crc16}
    q = {"Q" + axis: f32(value) for axis, value in zip("wxyz", fields["q_wxyz"])}
    rate, acceleration = xyz("Rate", fields["rate_rad_s"]), xyz("Acceleration", fields["acceleration_rad_s2"])
    return {"ATT_Q01": {key: q[key] for key in ("Qw", "Qx")}, "ATT_Q23": {key: q[key] for key in ("Qy", "Qz")},
            "ATT_W": rate, "ATT_A": acceleration, "ATT_T": head,
            "ATT_FD": {**head, **q, **{key: f32(value) for key, value in {**rate, **acceleration}.items()}}}


def samples(fields, count):
    padded = fields["samples_arcsec"] + [[0.0, 0.0]] * (count - len(fields["samples_arcsec"]))
    return {f"{axis}{i}": value for i, sample in enumerate(padded) for axis, value in zip("XY", sample)}


def status(f):
    page = f["page"]
    if page == 0:
        return {"Page": 0, "Mode": f["mode"], "Frames": f["frames"], "Latency": f["latency_us"]}
    if page == 1:
        return {"Page": 1, "Horizon": 10 * f["horizon_10us"], "PredictionError": f["error_arcsec"]}
    if page == 2:
        return {"Page": 2, "Drift": f["drift_0_1ppm"] / 10, "Residual": f["residual_ns"]}
    if page == 3:
        return {"Page": 3, "Reason": f["reason"], "Count": f["count"]}
    name = {4: "RightAscension", 5: "Declination", 6: "Roll"}[page]
    turns = f["turns_2_32"]
    if page > 4 and turns >= 2**31:
        turns -= 2**32
    return {"Page": page, name + "Frame": f["frame"], name + "Flags": f["flags"], name: turns * 360 / 2**32}


def camera_status(f):
    pages = {0: lambda: {"StartedBy": f["started_by"], "ExposureTime": f["exposure_us"]},
             1: lambda: {"Gain": f["gain_cdb"] / 100, "BlackLevel": f["black_level_dn_16"] / 16},
             2: lambda: {"TriggerDelay": f["delay_us"]}}
    return {"Page": f["page"], "Head": f["head"], "Frame": f["frame"], **pages[f["page"]]()}


def command(f):
    arguments = {1: lambda: {"Major": f["major"], "Minor": f["minor"]}, 2: lambda: {"InfoPage": f["page"]},
                 5: lambda: {"ApplyTable": f["table"], "ApplyRows": f["rows"], "ApplyCrc16": f["crc16"],
                             "ApplySeed": f["seed"]},
                 6: lambda: {"TriggerNumber": f["trigger"], "TriggerTime": f["at_us"]},
                 7: lambda: {"CameraKind": f["camera_kind"], "CameraHead": f["head"], "CameraValue": f["camera_value"]},
                 8: lambda: {"CameraTriggerHead": f["head"], "CameraTriggerTime": f["at_us"]}}
    return {"Opcode": f["opcode"], "Token": f["token"], **arguments.get(f["opcode"], dict)()}


def response(f):
    signals = {"Opcode": f["opcode"], "Token": f["token"], "Code": f["code"]}
    if f["opcode"] == 1:
        bits = f["capabilities"]
        signals |= {"Major": f["major"], "Minor": f["minor"], "ParameterTables": bits & 1, "JitterSamples": bits >> 1 & 1,
                    "WheelSpeeds": bits >> 2 & 1, "Triggers": bits >> 3 & 1, "Cameras": bits >> 4 & 1,
                    "AttitudeConvention": f["attitude_convention"]}
    elif f["opcode"] == 2 and f["page"] == 0:
        signals |= {"InfoPage": 0, "DbcCrc32": f["dbc_crc32"]}
    elif f["opcode"] == 2:
        signals |= {"InfoPage": 1, "AttitudeRate": f["attitude_hz"], "JitterRate": f["jitter_hz"]}
    elif f["opcode"] == 5:
        signals |= {"AppliedTable": f.get("table", 0), "AppliedRows": f.get("rows", 0)}
    elif f["opcode"] == 6:
        signals |= {"TriggeredNumber": f.get("trigger", 0), "TriggeredLate": f.get("late", 0)}
    elif f["opcode"] == 7:
        signals |= {"CameraKind": f.get("camera_kind", 0), "CameraHead": f.get("head", 0)}
    elif f["opcode"] == 8:
        signals |= {"CameraTriggeredHead": f.get("head", 0), "CameraTriggeredLate": f.get("late", 0)}
    return signals


def cell(f):
    name, columns = TABLES[f["table"]]
    return {"TableNumber": f["table"], "Row": f["row"], name + "Column": f["column"], name + columns[f["column"]]: f["value"]}


def signals_of(vector, name, data):
    """Returns the expected signals of one frame, from the vector's physical values. A CRC is taken from the bytes."""
    f, message = vector["fields"], vector["message"]
    if message == "ATT_FD":
        return attitude(f, int.from_bytes(data[6:8], "little"))[name]
    if message == "JITTER_FD":
        head = {"TimeTag": f["t_first_us"], "Period": f["period_us"], "Seq": f["seq"], "Samples": len(f["samples_arcsec"])}
        return head | samples(f, 14)
    return {
        "SYNC": lambda: {"Counter": f["counter"]},
        "TIME_FUP": lambda: {"Seconds": f["seconds"], "Fraction": f["fraction_2_24"] / 2**24, "Counter": f["counter"]},
        "EXPOSURE": lambda: {"Frame": f["frame"], "AttitudeSeq": f["attitude_seq"], "MidExposure": f["mid_exposure_us"],
                             "Age": f["age_us"]},
        "STATUS": lambda: status(f),
        "CAMERA_STATUS": lambda: camera_status(f),
        "WHEELS": lambda: {f"Speed{i}": speed for i, speed in enumerate(f["speed_rpm"])},
        "JITTER": lambda: {"Slot": f["slot"], **samples(f, 2)},
        "TABLE": lambda: cell(f),
        "RSP": lambda: response(f),
        "CMD": lambda: command(f),
        "HEARTBEAT": lambda: {"State": f["state"], "Major": f["major"]},
    }[message]()


def frames(vectors=VECTORS["messages"]):
    """(vector, frame) of everything at base 0, node 0, whose opcode the DBC names."""
    for vector in vectors:
        is_described = vector["id_bits"] == 11 and vector["base"] == vector["node"] == 0
        if is_described and vector["fields"].get("opcode", 0) <= 8:
            for frame in [vector["fd"]] + (vector["classic"] or []):
                yield vector, frame


def differences(db, vector, frame):
    # cantools marks identifiers of 29 bits, which have 8 digits, as DBC files do.
    identifier = int(frame["id"], 16) | (1 << 31 if len(frame["id"]) == 8 else 0)
    message, data = db.get_message_by_frame_id(identifier), bytes.fromhex(frame["data"])
    wanted = signals_of(vector, message.name, data)
    found = [] if len(data) == message.length else [f"{message.name}: {message.length} bytes"]
    if message.is_fd != (len(data) > 8):
        found.append(f"{message.name}: FD is {message.is_fd}")
    try:
        got = message.decode(data, decode_choices=False)
    except cantools.database.DecodeError as error:
        return found + [f"{message.name}: {error}"]
    if got.keys() != wanted.keys():
        return found + [f"{message.name}: signals {sorted(got)}, wanted {sorted(wanted)}"]
    for name, value in wanted.items():
        tolerance = abs(value) * (F32 if message.get_signal_by_name(name).is_float else F64)
        if message.name in ("ATT_W", "ATT_A"):
            tolerance = CLASSIC_RATE_RAD_S
        if abs(got[name] - value) > tolerance:
            found.append(f"{message.name}.{name}: {got[name]}, wanted {value}")
    return found


def documented_heads():
    """(offset, type code) of every scalar of the two tables of FRAMES.md, and the names of their rows."""
    codes = {"u8": "B", "u32": "I", "i64": "q", "u64": "Q", "f64": "d"}
    for table in (KIT / "FRAMES.md").read_text().split("| offset |")[1:]:
        places, names = [], []
        for row in table.splitlines()[2:]:
            if not row.startswith("|"):
                break
            offset, kind, name = (cell.strip() for cell in row.strip("|").split("|")[:3])
            scalar, _, count = kind.rstrip("]").partition("[")
            step = struct.calcsize(codes[scalar])
            if name != "reserved":
                places += [(int(offset) + step * i, codes[scalar]) for i in range(int(count or 1))]
                names.append(name)
        yield places, names


def places_of(form):
    """(offset, type code) of every scalar of a struct without padding."""
    places, at = [], 0
    for count, code in re.findall(r"(\d*)([a-zA-Z])", form.format):
        for _ in range(int(count or 1)):
            if code != "x":
                places.append((at, "B" if code == "s" else code))
            at += struct.calcsize("=B" if code in "sx" else "=" + code)
    return places


class SharedMemory(unittest.TestCase):
    def test_reader_has_the_documented_layout(self):
        (file_head, _), (slot_head, names) = documented_heads()
        self.assertEqual(places_of(FILE_HEAD), file_head)
        self.assertEqual(places_of(SLOT_HEAD), slot_head)
        self.assertEqual((FILE_HEAD.size, SLOT_HEAD.size), (64, 256))
        arrays = {"attitude_wxyz": ["qw", "qx", "qy", "qz"], "ra_dec_roll_deg": ["ra_deg", "dec_deg", "roll_deg"],
                  "rate_deg_s": ["rate_x_deg_s", "rate_y_deg_s", "rate_z_deg_s"]}
        self.assertEqual([name for row in names for name in arrays.get(row, [row])], SLOT_NAMES)


class AgainstTheVectors(unittest.TestCase):
    def test_every_frame_is_read_as_it_was_meant(self):
        db, count = database(), 0
        for vector, frame in frames():
            self.assertEqual(differences(db, vector, frame), [], vector["name"])
            count += 1
        self.assertGreater(count, 100)

    def test_every_frame_is_made_from_its_physical_values(self):
        db = database()
        for vector, frame in frames():
            message, data = db.get_message_by_frame_id(int(frame["id"], 16)), bytes.fromhex(frame["data"])
            encoded = message.encode(signals_of(vector, message.name, data), strict=False)
            self.assertEqual(encoded.hex(), frame["data"], vector["name"])

    def test_every_message_is_covered(self):
        seen = {int(frame["id"], 16) for _, frame in frames()}
        self.assertEqual(seen, {message.frame_id for message in database().messages})

    def test_a_flipped_byte_is_noticed(self):
        db = database()
        for vector, frame in frames():
            data = bytearray.fromhex(frame["data"])
            data[0] ^= 0x10
            self.assertNotEqual(differences(db, vector, {**frame, "data": data.hex()}), [], vector["name"])

    def test_the_lowest_counts_of_scaled_integers_are_refused(self):
        codec, count = Codec(), 0
        for rejected in VECTORS["rejected"]:
            if "lowest count" not in rejected["name"]:
                continue
            count += 1
            refused = [codec.fields(int(frame["id"], 16), bytes.fromhex(frame["data"])) is None for frame in rejected["frames"]]
            self.assertEqual(sum(refused), 1, rejected["name"])
        self.assertEqual(count, 16)
        # Negative control: everything that is sent is read.
        for vector, frame in frames():
            self.assertIsNotNone(codec.fields(int(frame["id"], 16), bytes.fromhex(frame["data"])), vector["name"])

    def test_every_refusal_has_a_meaning_in_the_scripts(self):
        codec = Codec()
        names = codec.database.get_message_by_name("RSP").get_signal_by_name("Code").choices
        self.assertEqual(sorted(REFUSALS), sorted(code for code in names if code != 0))
        self.assertTrue(codec.refusal(11).startswith("UnknownTrigger (code 11): "))
        self.assertIn("later version", codec.refusal(200))

    def test_a_moved_signal_is_noticed(self):
        text = (KIT / "dbc/starloop.dbc").read_text()
        for right, wrong in [("Qw : 64|32", "Qw : 65|31"), ("Speed1 : 16|16@1- (0.25,0)", "Speed1 : 16|16@1- (0.5,0)"),
                             ("SIG_VALTYPE_ 1152 PsdDensityX : 1;\n", "")]:
            self.assertIn(right, text)
            db = cantools.database.load_string(text.replace(right, wrong), "dbc", strict=False)
            self.assertTrue(any(differences(db, *each) for each in frames()), wrong)

    def test_the_file_of_another_address_has_its_identifiers(self):
        readdressed = lambda *words: subprocess.run([sys.executable, KIT / "dbc/readdress.py", *words], capture_output=True, text=True)
        for vector in VECTORS["messages"]:
            if (vector["id_bits"], vector["base"], vector["node"]) == (11, 0, 0):
                continue
            place = {"node": vector["node"], "id-base": vector["base"], "id-bits": vector["id_bits"]}
            options = [text for key, value in place.items() for text in (f"--{key}", str(value))]
            made = readdressed(*options)
            db = cantools.database.load_string(made.stdout, "dbc")
            described = db.get_message_by_name(vector["message"])
            self.assertEqual(described.frame_id, int(vector["fd"]["id"], 16), vector["name"])
            self.assertEqual({message.is_extended_frame for message in db.messages}, {vector["id_bits"] == 29})
            self.assertEqual(differences(db, vector, vector["fd"]), [], vector["name"])
        # Without a change the file itself comes out; an address that does not exist is refused.
        self.assertEqual(readdressed().stdout, (KIT / "dbc/starloop.dbc").read_text())
        for options in (["--id-base", "0x100"], ["--id-base", "0x1FFFF900", "--id-bits", "29"], ["--id-base", "8"], ["--node", "16"]):
            self.assertEqual(readdressed(*options).returncode, 2, options)

    def test_cycles_and_senders_are_reported(self):
        db = database()
        cycles = {message.name: message.cycle_time for message in db.messages if message.cycle_time}
        self.assertEqual(cycles["ATT_FD"], 10)
        self.assertEqual(db.get_message_by_name("STATUS").senders, ["STIMULATOR"])
        self.assertTrue(all(message.comment for message in db.messages))


if __name__ == "__main__":
    unittest.main()
