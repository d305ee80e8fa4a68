"""XML from outside, read so that it can do no harm.

Nothing is fetched, no file is opened for an entity, and a document that declares
entities is refused: what it means could be a thousand times its length. What stands
before the XML declaration is ignored, and a namespace need not be declared, as
for TinyXML in Gazebo and RViz: an undeclared prefix is part of the name.
"""

from __future__ import annotations

import copy
import re
from collections.abc import Callable
from contextlib import suppress

from lxml import etree

from g1_description.errors import DescriptionError

MAX_SIZE = 10_000_000
"""No robot or model has more bytes: it is something else, or a mistake."""

_DECLARATION = re.compile(
    r"((?:\s|\ufeff|<!--(?:(?!-->).)*-->)*)<\?xml\s(?:(?!\?>).)*\?>", re.DOTALL
)
"""The XML declaration, and the blanks and comments before it."""

_ENCODING = re.compile(r"""\sencoding\s*=\s*["']([\w.-]+)["']""", re.ASCII)

_CHARSET = re.compile(r"(ascii|us|iso|latin|windows|cp|koi|mac|gb|big|euc|shift)", re.I)
"""How the names of charsets begin; Python has encodings that are none."""

_ASCII = "".join(map(chr, range(128)))


def decoded(data: bytes, errors: str = "strict") -> str:
    """Give the text of an XML file.

    Args:
        data: The file: UTF-8, whatever it declares, or what it declares.
        errors: What ``bytes.decode`` does about a file that is neither.

    Returns:
        The text; without its declaration, where that declares another encoding.

    Raises:
        UnicodeDecodeError: If the file is neither.
    """
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        encoding = _declared_encoding(data)
    with suppress(UnicodeDecodeError):
        return _without_declaration(data.decode(encoding))
    return data.decode("utf-8", errors)


def check_size(what: str, size: int) -> None:
    """Refuse what is too large to be a robot or a model.

    Args:
        what: What it is, as the sentence begins: "The robot description".
        size: In bytes.

    Raises:
        DescriptionError: If it is.
    """
    if size > MAX_SIZE:
        raise DescriptionError(
            f"{what} is {size / 1e6:.6g} MB; the limit is {MAX_SIZE / 1e6:.0f} MB."
        )


def _declared_encoding(data: bytes) -> str:
    """Find the encoding that an XML file declares; UTF-8 where it is no known one."""
    declaration = _DECLARATION.match(data.decode("latin-1"))
    if declaration:
        named = _ENCODING.search(declaration[0], declaration.end(1))
        with suppress(LookupError, UnicodeError):
            # Only in an extension of ASCII the declaration itself can be read.
            name = named[1] if named else ""
            if _CHARSET.match(name) and _ASCII.encode().decode(name) == _ASCII:
                return name
    return "utf-8"


def _without_declaration(text: str) -> str:
    """Take the XML declaration out of a document, and leave what stands before it."""
    declaration = _DECLARATION.match(text)
    return declaration[1] + text[declaration.end() :] if declaration else text


def parse_xml(what: str, text: str, keep_comments: bool = False) -> etree._Element:
    """Read a document.

    Args:
        what: What it should be, for the sentences: "robot description".
        text: XML; its declaration is ignored, the text is text already.
        keep_comments: Whether comments and processing instructions stay.

    Returns:
        The root element.

    Raises:
        DescriptionError: If it is not XML, or declares entities.
    """
    text = _without_declaration(text)
    parser = _parser(keep_comments)
    try:
        data = text.lstrip("\ufeff").encode("utf-8")
        try:
            root = etree.fromstring(data, parser)
        except SyntaxError:
            if not parser.error_log or _faults(parser):
                raise
            root = etree.fromstring(data, _parser(keep_comments, recover=True))
    # A reader's ParseError is a SyntaxError, a character that is none a ValueError.
    except (SyntaxError, ValueError) as error:
        # The text of a ParseError repeats the line, behind the name of no file.
        why = next(iter(_faults(parser)), getattr(error, "msg", None) or error)
        raise DescriptionError(f"The {what} is not XML: {why}.") from error
    if root.getroottree().docinfo.doctype:
        raise DescriptionError(f"The {what} has a DOCTYPE; no entities are read.")
    return root


def _parser(keep_comments: bool, recover: bool = False) -> etree.XMLParser:
    """Make a reader that does no harm; one that recovers takes what is no XML."""
    return etree.XMLParser(
        resolve_entities=False,
        no_network=True,
        load_dtd=False,
        huge_tree=False,
        remove_comments=not keep_comments,
        remove_pis=not keep_comments,
        encoding="utf-8",
        recover=recover,
    )


def _faults(parser: etree.XMLParser) -> list[str]:
    """Say what is wrong with a document, but for its namespaces."""
    return [
        f"{entry.message}, line {entry.line}, column {entry.column}"
        for entry in parser.error_log
        if entry.domain != etree.ErrorDomains.NAMESPACE
    ]


def local_name(element: etree._Element) -> str:
    """Give the tag of an element without its prefix, declared or not."""
    return str(element.tag).rpartition("}")[2].rpartition(":")[2]


def part_at_fault(
    root: etree._Element, is_readable: Callable[[etree._Element], bool]
) -> str:
    """Find which child of an element makes it unreadable.

    Args:
        root: An element that cannot be read.
        is_readable: Tells whether an element can be read; given the root with one
            child at a time.

    Returns:
        Tag, name and line of the first such child, with a colon; empty if each can
        be read alone.
    """
    for part in root:
        alone = etree.Element(root.tag, root.attrib)
        alone.append(copy.deepcopy(part))
        if not is_readable(alone):
            return f"<{part.tag}> {part.get('name', '')}, line {part.sourceline}: "
    return ""
