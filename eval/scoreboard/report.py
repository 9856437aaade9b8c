"""`html`: the scoreboard and all its runs as one self-contained page, which needs no network."""

import re
from base64 import b64encode
from collections.abc import Mapping
from typing import Any

from markdown_it import MarkdownIt

from eval.scoreboard.page import markdown, runs_table

HEAD = """<meta charset="utf-8">
<title>irs_gym scoreboard</title>
<meta name="viewport" content="width=device-width">
<link rel="icon" href="data:,">
"""
STYLE = """
:root { color-scheme: light dark; }
body { font: 15px/1.5 system-ui, sans-serif; max-width: 78rem; margin: 0 auto; padding: 0 1.5rem 4rem; }
nav { position: sticky; top: 0; padding: .6rem 0; background: Canvas; border-bottom: 1px solid #8886; font-size: 13px; }
nav { display: flex; flex-wrap: wrap; }
nav a { margin-right: 1rem; white-space: nowrap; }
h2 { margin-top: 2.5rem; scroll-margin-top: 4rem; }
pre { padding: .6rem 1rem; background: #8882; overflow-x: auto; }
.table { overflow-x: auto; }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; }
th, td { padding: .3rem .7rem; border-bottom: 1px solid #8884; text-align: left; vertical-align: top; }
th { border-bottom: 2px solid #888; }
td { white-space: nowrap; }
td:last-child { white-space: normal; min-width: 7rem; }
sub { vertical-align: baseline; font-size: 11.5px; opacity: .75; }
img { max-width: 100%; background: white; }
"""


def html(board: Mapping[str, Any], pictures: Mapping[str, bytes]) -> str:
    """The page: the scoreboard in Markdown, then every run, with the pictures inside."""
    text = markdown(board, "") + "\n## All runs\n\n" + runs_table(board) + "\n"
    body = MarkdownIt("commonmark").enable("table").render(text)
    body = body.replace("<table>", '<div class="table"><table>').replace(
        "</table>", "</table></div>"
    )

    for name, content in pictures.items():
        body = body.replace(
            f'src="/{name}"', f'src="data:image/png;base64,{b64encode(content).decode()}"'
        )

    titles: list[str] = re.findall("<h2>(.*?)</h2>", body)
    for n, title in enumerate(titles):
        body = body.replace(f"<h2>{title}</h2>", f'<h2 id="s{n}">{title}</h2>')

    links = "".join(f'<a href="#s{n}">{title}</a>' for n, title in enumerate(titles))

    return (
        f'<!DOCTYPE html>\n<html lang="en">\n<head>\n{HEAD}<style>{STYLE}</style>\n</head>\n'
        f"<body>\n<nav>{links}</nav>\n{body}</body>\n</html>\n"
    )
