"""A package that stands as if it were installed: a folder with its modules and its entry points."""

import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

from config.documents.kinds import forgotten


def write_package(
    folder: Path,
    name: str,
    modules: Mapping[str, str],
    points: Mapping[str, Mapping[str, str]],
    version: str = "1.2",
) -> Path:
    """modules: source by name, without `.py`. points: by group, what each name leads to."""
    package = folder / name
    package.mkdir(parents=True)
    (package / "__init__.py").write_text('"""A package of somebody else\'s."""\n')
    for module, source in modules.items():
        (package / f"{module}.py").write_text(source)
    about = folder / f"{name}-{version}.dist-info"
    about.mkdir()
    (about / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: {version}\n")
    lines = [
        line
        for group, values in points.items()
        for line in (f"[{group}]", *(f"{key} = {value}" for key, value in values.items()))
    ]
    (about / "entry_points.txt").write_text("\n".join(lines) + "\n")
    return folder


@contextmanager
def installed(*folders: Path) -> Iterator[None]:
    """Within it these are on the path; after it, as if they had never been."""
    before = set(sys.modules)
    sys.path[:0] = [str(folder) for folder in folders]
    try:
        with forgotten():
            yield
    finally:
        for folder in folders:
            sys.path.remove(str(folder))
        for name in set(sys.modules) - before:
            origin = getattr(sys.modules[name], "__file__", None) or ""
            if any(origin.startswith(str(folder)) for folder in folders):
                del sys.modules[name]
