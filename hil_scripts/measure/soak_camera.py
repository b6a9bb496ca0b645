"""Client of a network camera for soak.py, by Aravis: /usr/bin/python3 hil_scripts/measure/soak_camera.py ADDRESS FILE

Takes frames until its standard input ends, and writes a line for each: the frame's number, the CRC-32 of its pixels, and the
state of Aravis's buffer. A frame that did not come whole has no number. The last line has the counts of the stream.
"""

import json
import select
import sys
import time
import zlib

from aravis import Aravis, stream_of

#: Seconds in which another client's control of the camera ends.
PATIENCE_S = 30.0
WHOLE = "success"


def connected(address):
    """Returns a camera that this client controls, after the client before it is forgotten."""
    from gi.repository import GLib

    until = time.monotonic() + PATIENCE_S
    while True:
        try:
            camera = Aravis.Camera.new(address)
            camera.get_device().set_boolean_feature_value("ChunkModeActive", True)
            return camera
        except GLib.Error:
            camera = None
            if time.monotonic() > until:
                raise
            time.sleep(0.2)


def take(stream, parser, out):
    """Writes lines until standard input has something or ends."""
    asked = 0.0
    while True:
        buffer = stream.timeout_pop_buffer(100_000)
        if buffer is not None:
            out.write(line_of(buffer, parser))
            stream.push_buffer(buffer)
        now = time.monotonic()
        if now - asked > 0.1:
            asked = now
            out.flush()
            if select.select([sys.stdin], [], [], 0.0)[0]:
                return


def line_of(buffer, parser):
    state = buffer.get_status().value_nick
    if state != WHOLE:
        return f",,{state}\n"
    size = 2 * buffer.get_image_width() * buffer.get_image_height()
    crc32 = zlib.crc32(memoryview(buffer.get_image_data())[:size])
    return f"{parser.get_integer_value(buffer, 'ChunkFrameID')},{crc32:08x},{state}\n"


def main():
    address, path = sys.argv[1:]
    camera = connected(address)
    stream, parser = stream_of(camera, 40, 2_000_000, 4 << 20), camera.create_chunk_parser()
    with open(path, "w") as out:
        camera.start_acquisition()
        print("streaming", flush=True)
        take(stream, parser, out)
        try:
            camera.stop_acquisition()
        except Exception as error:  # the camera is gone when its run is over
            print(error, file=sys.stderr)
        names = ("n_completed_buffers", "n_failures", "n_underruns", "n_missing_packets", "n_resent_packets", "n_resend_requests")
        counts = {name: stream.get_info_uint64_by_name(name) for name in names}
        out.write(f"end,,{json.dumps(counts)}\n")


if __name__ == "__main__":
    main()
