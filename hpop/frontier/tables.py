"""A front as a table of pandas or a dataset of xarray, which are imported when they are asked for."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from hpop.base.lazy import library

if TYPE_CHECKING:
    import pandas
    import xarray

    from hpop.frontier.front import Front

ORIGIN = "provenance."


def dataframe(front: Front[Any]) -> pandas.DataFrame:
    """A row a point: its costs, its reported values, and a column for each key of the provenances."""
    frame = library("pandas", "to_dataframe()").DataFrame(_columns(front), index=_index(front))
    frame.index.name = "point"
    frame.attrs.update(units=_units(front), **_claims(front))
    return frame


def dataset(front: Front[Any]) -> xarray.Dataset:
    """A variable a column along "point", with its unit where it has one."""
    units = _units(front)
    variables = {
        name: ("point", values, {"units": units[name]} if name in units else {})
        for name, values in _columns(front).items()
    }
    return library("xarray", "to_xarray()").Dataset(variables, {"point": _index(front)}, _claims(front))


def _columns(front: Front[Any]) -> dict[str, Any]:
    columns: dict[str, Any] = dict(zip(front.names, front.costs.T, strict=True))
    columns |= zip(front.reported_names, front.reported.T, strict=True)
    for key in dict.fromkeys(key for origin in front.provenance for key in origin):
        values = np.empty(len(front), dtype=object)
        for row, origin in enumerate(front.provenance):
            values[row] = origin.get(key)
        columns[ORIGIN + key] = values
    return columns


def _index(front: Front[Any]) -> np.ndarray[Any, np.dtype[np.int64]]:
    return np.arange(len(front))


def _units(front: Front[Any]) -> dict[str, str]:
    return dict(zip(front.names + front.reported_names, front.units + front.reported_units, strict=True))


def _claims(front: Front[Any]) -> dict[str, str]:
    return {"status": front.status, "certificate": front.certificate}
