"""`python -m tests.docs.reference`: writes `docs/reference` anew, and `docs/api.md`."""

from tests.daemon.api.reference import reference
from tests.docs.reference import FOLDER, PAGES, page

for name in PAGES:
    (FOLDER / f"{name}.md").write_text(page(name), encoding="utf-8")
(FOLDER.parent / "api.md").write_text(reference(), encoding="utf-8")
