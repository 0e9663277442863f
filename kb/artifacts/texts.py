"""Which files the texts of a source are read from: clean tables, else restored, else released ones.

`kb links` and `kb index` read them. Their manifests have the digests of these files as inputs, also
where they are made from a download.
"""

from pathlib import Path

from kb.artifacts import manifest
from kb.artifacts.table_catalog import Catalog
from kb.store.artifact_registry import ARTIFACTS


def files(root: Path, name: str, catalog: Catalog | None = None) -> dict[str, list[Path]]:
    """The files of each table that an artifact reads, in order; tables without files are left out.
    `catalog` is that of the root, where it was read already.

    Raises DamagedData for a lost file.
    """
    catalog = catalog or Catalog(root.absolute())
    texts = {table: catalog.texts(table) for table in ARTIFACTS[name].reads}
    return {table: paths for table, paths in texts.items() if paths}


def is_restored(root: Path, source: str) -> bool:
    """Whether a source's rows are those that `kb restore` brought back: no filter kept any here."""
    return Catalog(root.absolute()).schema_of(source) == "restored"


def exported_files(catalog: Catalog, name: str) -> list[Path]:
    """The files of a table that exports read: clean ones, else restored ones; of a download
    released ones that hold texts. Raises DamagedData for a lost file.
    """
    if catalog.is_download:
        return catalog.texts(name)
    if catalog.schema_of(name.partition("/")[0]) == "restored":
        return catalog.files(name)
    return manifest.rows(catalog.path, name)


def inputs(root: Path, name: str, catalog: Catalog | None = None) -> dict[str, str]:
    """The digests of an artifact's inputs as they are now; `catalog` as in `files`. Raises
    DamagedData for a lost file.
    """
    return manifest.inputs(root, name, (catalog or Catalog(root.absolute())).texts)


def changed(root: Path, name: str) -> list[str]:
    """The sources whose texts differ from those that the artifact was made from, where an older
    version has not noted them: none. Raises DamagedData.
    """
    known = manifest.read_manifest(Catalog(root.absolute()).workplace, name)
    if known is None or not known.inputs:
        return []
    now = inputs(root, name)
    return [
        name.partition("/")[2]
        for name in now
        if name.startswith("clean/") and now[name] != known.inputs.get(name)
    ]
