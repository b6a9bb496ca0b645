"""Data sets: items one by one, whole folders, and a source for Ray Data."""

from __future__ import annotations

import functools
import json
import os
from typing import Any, Dict, Iterator, List, Mapping, Optional, Tuple, Union

from . import _native
from .camera import Frame, toml_text

Spec = Union[str, "os.PathLike[str]", Mapping[str, Any]]


class Item:
    """One item: its frame and its labels."""

    def __init__(self, frame: Frame, labels: Dict[str, Any]):
        self.frame = frame
        self.labels = labels
        """Columns of the table of items, and `sources`: a list with the columns of the table of stars."""

    @property
    def image(self) -> Any:
        """Digital numbers, shape (height, width)."""
        return self.frame.image


class DataSet:
    """A description of a data set: a TOML file, or a dict with its tables.

    >>> stars = DataSet({"name": "x", "camera": "cameras/small_tracker.toml"})
    >>> stars[5].image.shape
    (256, 256)

    Item i is the same here and in a folder that `starloop dataset` writes. Items near each other share a prepared camera.
    """

    def __init__(self, spec: Spec, *, folder: str = "."):
        if isinstance(spec, Mapping):
            self._source: Tuple[str, Optional[str]] = (toml_text(spec), folder)
            self._native = _native.DataSet.parse(self._source[0], folder)
        else:
            self._source = (os.fspath(spec), None)
            self._native = _native.DataSet.open(self._source[0])
        facts = json.loads(self._native.facts())
        self.name: str = facts["name"]
        """Its name."""
        self.shard_items: int = facts["shard_items"]
        """Items of a shard, which share a camera."""

    def __getitem__(self, number: int) -> Item:
        frame, labels = self._native.item(number)
        return Item(Frame(frame), json.loads(labels))

    def items(self, first: int, end: int) -> Iterator[Item]:
        """Yields the items from `first` to `end`, the last one excluded."""
        for number in range(first, end):
            yield self[number]

    def make(
        self,
        count: int,
        out: Union[str, "os.PathLike[str]"],
        *,
        workers: Optional[int] = None,
        images: Optional[str] = None,
        shards: Optional[Tuple[int, int]] = None,
    ) -> Dict[str, Any]:
        """Draws the items 0 to `count` - 1 into a folder, as `starloop dataset` does; returns what was made.

        `workers` are threads (all cores by default), `images` is fits, png, webdataset or zarr, `shards` a part of all
        shards, the second excluded. A folder that is begun is gone on with. Raises ValueError with the reason.
        """
        made: Dict[str, Any] = json.loads(self._native.make(count, os.fspath(out), workers, images, shards))
        return made

    def __reduce__(self) -> Any:
        source, folder = self._source
        return _opened, (source, folder)


def _opened(source: str, folder: Optional[str]) -> DataSet:
    """Returns the data set that was pickled."""
    made = DataSet.__new__(DataSet)
    made._source = (source, folder)
    made._native = _native.DataSet.open(source) if folder is None else _native.DataSet.parse(source, folder)
    facts = json.loads(made._native.facts())
    made.name, made.shard_items = facts["name"], facts["shard_items"]
    return made


def dataset(spec: Spec, count: int, out: Union[str, "os.PathLike[str]"], **keywords: Any) -> Dict[str, Any]:
    """Draws a data set into a folder: `DataSet(spec).make(count, out, ...)`."""
    return DataSet(spec).make(count, out, **keywords)


def ray_source(spec: Spec, count: int) -> Any:
    """Returns a source for `ray.data.read_datasource`: a row for each item, with `item`, `image` and `labels` (JSON).

    A read task draws one shard, on one core. Needs ray[data].
    """
    from ray.data import Datasource, ReadTask  # type: ignore[import-untyped, import-not-found, unused-ignore]
    from ray.data.block import BlockMetadata  # type: ignore[import-untyped, import-not-found, unused-ignore]

    described = DataSet(spec)

    def rows(first: int, end: int) -> Any:
        import pandas  # type: ignore[import-untyped, import-not-found, unused-ignore]

        drawn = list(described.items(first, end))
        numbers: List[int] = list(range(first, end))
        yield pandas.DataFrame(
            {"item": numbers, "image": [item.image for item in drawn], "labels": [json.dumps(item.labels) for item in drawn]}
        )

    class StarloopSource(Datasource):  # type: ignore[misc, unused-ignore]
        """Draws shards where Ray runs its tasks."""

        def estimate_inmemory_data_size(self) -> Optional[int]:
            return None

        def get_read_tasks(self, parallelism: int, *_: Any, **__: Any) -> List[Any]:
            tasks = []
            for first in range(0, count, described.shard_items):
                end = min(first + described.shard_items, count)
                metadata = BlockMetadata(num_rows=end - first, size_bytes=None, input_files=None, exec_stats=None)
                tasks.append(ReadTask(functools.partial(rows, first, end), metadata))
            return tasks

    source: Any = StarloopSource
    return source()
