"""What a page loads, says and shows in tables, read from its HTML."""

from html.parser import HTMLParser


class Page(HTMLParser):
    """What a page loads, links to and says, its tables, and whether its tags match."""

    def __init__(self, path):
        super().__init__()
        self.loaded, self.open, self.text, self.grids, self.blocks = [], [], [], [], []
        self.feed(path.read_text(encoding="utf-8"))
        self.words = " ".join("".join(self.text).split())
        assert self.open == []

    @property
    def tables(self):
        return len(self.grids)

    def table(self, title):
        """Return the rows of the table whose title begins so, its headings first."""
        (grid,) = (rows for rows in self.grids if rows[0][0].startswith(title))
        return grid[1:]

    def handle_starttag(self, tag, attrs):
        self.loaded += [value for key, value in attrs if key in ("src", "href", "srcset", "data", "action", "poster")]
        if tag == "table":
            self.grids.append([])
        elif tag in ("tr", "caption"):
            self.grids[-1].append([""] if tag == "caption" else [])
        elif tag in ("td", "th"):
            self.grids[-1][-1].append("")
        elif tag == "pre":
            self.blocks.append("")
        if tag not in ("meta", "img", "br"):
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.text.append(data)
        if {"td", "th", "caption"} & {*self.open}:
            self.grids[-1][-1][-1] += data
        elif "pre" in self.open:
            self.blocks[-1] += data
