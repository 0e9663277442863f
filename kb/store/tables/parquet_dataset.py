"""Parquet files as one pyarrow Dataset, of which every page that is read is verified."""

from collections.abc import Sequence

import pyarrow.dataset as ds
from pyarrow.fs import FileSystem

_VERIFIED = ds.ParquetFileFormat(
    default_fragment_scan_options=ds.ParquetFragmentScanOptions(page_checksum_verification=True)
)


def parquet_dataset(files: Sequence[str], system: FileSystem | None = None) -> ds.Dataset:
    """The files, in order, of this machine or of another file system."""
    return ds.dataset(list(files), format=_VERIFIED, filesystem=system)
