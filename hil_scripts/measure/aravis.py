"""Streams of network cameras by Aravis, in the system's Python, for measurements and tests: from aravis import Aravis, stream_of"""

import gi

gi.require_version("Aravis", "0.8")
from gi.repository import Aravis  # noqa: E402 - the version comes first


def stream_of(camera, buffers=10, retention_us=5_000_000, socket_bytes=None):
    """Returns a stream with free buffers, patient with a busy machine, where packets and processes may be late."""
    # As root Aravis would listen to raw packets, and to those of every interface until its filter is in place: what else
    # is on the wire then, such as a flood, is taken for images.
    camera.gv_set_stream_options(Aravis.GvStreamOption.PACKET_SOCKET_DISABLED)
    stream = camera.create_stream(None, None)
    stream.set_property("frame-retention", retention_us)
    stream.set_property("packet-request-ratio", 1.0)
    if socket_bytes:
        stream.set_property("socket-buffer", Aravis.GvStreamSocketBuffer.FIXED)
        stream.set_property("socket-buffer-size", socket_bytes)
    payload = camera.get_payload()
    for _ in range(buffers):
        stream.push_buffer(Aravis.Buffer.new_allocate(payload))
    return stream
