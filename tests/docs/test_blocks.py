"""How blocks are found in a page."""

from tests.docs.blocks import Block, _blocks

PAGE = """\
# A page

```sh
# takes minutes
tentacled explore builtin:soft_arm \\
    --out data.npz   # and what it is for
tentacled hold; tentacled resume
```

1. In a list:

   ```python
   def follow():
       pass
   ```

```
output
```
"""


def test_blocks_are_found_with_their_place_and_language() -> None:
    found = list(_blocks("a.md", PAGE))
    assert [(one.line, one.language) for one in found] == [(4, "sh"), (13, "python"), (18, "")]
    assert found[1].text == "def follow():\n    pass\n"


def test_commands_are_whole_and_without_comments() -> None:
    block = next(_blocks("a.md", PAGE))
    assert [line.split() for line in block.commands] == [
        ["tentacled", "explore", "builtin:soft_arm", "--out", "data.npz"],
        ["tentacled", "hold"],
        ["tentacled", "resume"],
    ]


def test_the_first_line_says_how_it_is_run() -> None:
    assert next(_blocks("a.md", PAGE)).mark == "long"
    assert Block("a.md", 1, "sh", "tentacled doctor\n").mark == "run"
    assert Block("a.md", 1, "sh", "# as root\nip link\n").mark == "not run"
