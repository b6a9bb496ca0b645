"""starloop: what a star sensor sees, in Python.

    import starloop

    camera = starloop.Camera("cameras/star_tracker_20deg.toml")
    frame = camera.render(ra=83.8, dec=-5.4, time="2026-05-01T00:00:00Z")
    print(frame.image.shape, len(frame.truth), frame.meta["ra_deg"])

    with starloop.Run("benches/closed_loop_small.toml", settings={"timing.duration_s": 5}) as run:
        for frame in run.frames():
            print(frame.meta["number"], frame.image.max())

Files are paths, or names of built-in ones. Angles are in degrees, attitudes are quaternions w, x, y, z with
v_sensor = q v_icrf q* (Hamilton, scalar first). Images are arrays of rows and columns, the first row at the top.

These come with the wheel. A clone and the Debian package have the modules that need no compiled one: `starloop.client`,
`starloop.wire`, `starloop.flight_computer`, `starloop.shared_frames` and others.
"""

try:
    from ._native import version as _version
except ModuleNotFoundError as missing:
    if missing.name != "starloop._native":
        raise
else:
    from .camera import Camera, Frame
    from .data_set import DataSet, Item, dataset, ray_source
    from .run import Run, StarloopError

    __version__ = _version()
    __all__ = ["Camera", "DataSet", "Frame", "Item", "Run", "StarloopError", "__version__", "dataset", "ray_source"]
