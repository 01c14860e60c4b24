"""The site's pages that are run when it is built."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

DOCS = Path(__file__).resolve().parents[1] / "docs"


@pytest.fixture
def executed(monkeypatch):
    monkeypatch.syspath_prepend(DOCS)
    import executed

    return executed


PAGE = """# Page

```yaml
version: 1
name: given
```

```sh
twilight solvers
cd elsewhere
```

```python
from pathlib import Path
kept = Path("given.yaml").read_text().count("name")
```

```python
print("kept", kept)
```

```python no-run
raise SystemExit(1)
```
"""


def test_what_a_page_shows_is_what_is_printed(executed):
    found = executed.run_page(PAGE)
    said = re.findall(r"^```text\n(.*?)^```$", found, flags=re.MULTILINE | re.DOTALL)
    assert len(said) == 2 and "zones" in said[0] and said[1] == "kept 1\n"
    assert re.sub(r"\n\n```text\n.*?\n```", "", found, flags=re.DOTALL) == PAGE


@pytest.mark.parametrize(
    "block", ["```python\nimport nothing_of_this_name\n```\n", "```sh\ntwilight render no-such-climate\n```\n"]
)
def test_a_page_that_fails_is_an_error(executed, block):
    with pytest.raises(executed.PageError, match=r"nothing_of_this_name|no-such-climate"):
        executed.run_page(f"# Page\n\n{block}")


def test_the_pages_are_there_and_show_something(executed):
    for name in executed.PAGES:
        text = (DOCS / f"{name}.md").read_text(encoding="utf-8")
        assert any(language in ("sh", "python") for language, _ in executed.FENCE.findall(text)), name
