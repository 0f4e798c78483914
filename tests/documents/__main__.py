"""List what the tests of the pages do not run, with the reasons: ``python -m tests.documents``."""

from tests.documents.blocks import PAGES, blocks_of, commands_of

for page in PAGES:
    for block in blocks_of(page):
        for mark in block.marks:
            print(f"{block.place}: {mark.kind}: {mark.reason}")
            if block.language == "sh":
                print(*(f"    {each}" for each in commands_of(block.text) if mark.holds_for(each)), sep="\n")
