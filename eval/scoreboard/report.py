"""`html`: the scoreboard and all its runs as one self-contained page, which needs no network."""

import re
from base64 import b64encode
from collections.abc import Mapping
from typing import Any

from markdown_it import MarkdownIt

from eval.markdown import template
from eval.scoreboard.page import runs_table, scoreboard_page

HEAD = """<meta charset="utf-8">
<title>irs_gym scoreboard</title>
<meta name="viewport" content="width=device-width">
<link rel="icon" href="data:,">
"""


def html(board: Mapping[str, Any], pictures: Mapping[str, bytes]) -> str:
    """The page: the scoreboard in Markdown, then every run, with the pictures inside."""
    text = scoreboard_page(board, "") + "\n## All runs\n\n" + runs_table(board) + "\n"
    body = MarkdownIt("commonmark").enable("table").render(text)

    # a wide table scrolls by itself, not with the page
    body = body.replace("<table>", '<div class="table"><table>')
    body = body.replace("</table>", "</table></div>")

    for name, content in pictures.items():
        body = body.replace(
            f'src="/{name}"', f'src="data:image/png;base64,{b64encode(content).decode()}"'
        )

    titles: list[str] = re.findall("<h2>(.*?)</h2>", body)
    for n, title in enumerate(titles):
        body = body.replace(f"<h2>{title}</h2>", f'<h2 id="s{n}">{title}</h2>')

    links = "".join(f'<a href="#s{n}">{title}</a>' for n, title in enumerate(titles))

    style = template("report.css")

    return (
        f'<!DOCTYPE html>\n<html lang="en">\n<head>\n{HEAD}<style>\n{style}</style>\n</head>\n'
        f"<body>\n<nav>{links}</nav>\n{body}</body>\n</html>\n"
    )
