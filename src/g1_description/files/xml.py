"""Safe reading of XML from outside.

Nothing is fetched, no file is opened for an entity, and documents that declare entities
are refused, as they may expand a thousandfold. As with TinyXML in Gazebo and RViz, text
before the XML declaration is ignored, and an undeclared namespace prefix is part of the
name.
"""

from __future__ import annotations

import copy
import re
from collections.abc import Callable
from contextlib import suppress

from lxml import etree

from g1_description.errors import DescriptionError

MAX_SIZE = 10_000_000
"""Largest robot description or model in bytes."""

_DECLARATION = re.compile(
    r"((?:\s|\ufeff|<!--(?:(?!-->).)*-->)*)<\?xml\s(?:(?!\?>).)*\?>", re.DOTALL
)
"""The XML declaration, and the blanks and comments before it."""

_ENCODING = re.compile(r"""\sencoding\s*=\s*["']([\w.-]+)["']""", re.ASCII)

_CHARSET = re.compile(r"(ascii|us|iso|latin|windows|cp|koi|mac|gb|big|euc|shift)", re.I)
"""Beginnings of names of charsets; Python also has other codecs."""

_ASCII = "".join(map(chr, range(128)))


def decoded(data: bytes, errors: str = "strict") -> str:
    """Decode an XML file.

    Args:
        data: The file, in UTF-8 or the declared encoding.
        errors: As for ``bytes.decode``, if it is in neither.

    Returns:
        The text; without its declaration if that declares another encoding.

    Raises:
        UnicodeDecodeError: If it is in neither.
    """
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        encoding = _declared_encoding(data)
    with suppress(UnicodeDecodeError):
        return _without_declaration(data.decode(encoding))
    return data.decode("utf-8", errors)


def check_size(label: str, size: int) -> None:
    """Check the size of a robot description or model.

    Args:
        label: Subject of the message, such as "The robot description".
        size: In bytes.

    Raises:
        DescriptionError: If it is too large.
    """
    if size > MAX_SIZE:
        raise DescriptionError(
            f"{label} is {size / 1e6:.6g} MB; the limit is {MAX_SIZE / 1e6:.0f} MB."
        )


def _declared_encoding(data: bytes) -> str:
    """Find the declared encoding of an XML file; UTF-8 if it is unknown."""
    declaration = _DECLARATION.match(data.decode("latin-1"))
    if declaration:
        named = _ENCODING.search(declaration[0], declaration.end(1))
        with suppress(LookupError, UnicodeError):
            # The declaration is readable only in extensions of ASCII.
            name = named[1] if named else ""
            if _CHARSET.match(name) and _ASCII.encode().decode(name) == _ASCII:
                return name
    return "utf-8"


def _without_declaration(text: str) -> str:
    """Remove the XML declaration of a document, but not the text before it."""
    declaration = _DECLARATION.match(text)
    return declaration[1] + text[declaration.end() :] if declaration else text


def parse_xml(label: str, text: str, keep_comments: bool = False) -> etree._Element:
    """Read a document.

    Args:
        label: Kind of document for messages, such as "robot description".
        text: XML; its declaration is ignored.
        keep_comments: Whether to keep comments and processing instructions.

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
    # A ParseError is a SyntaxError, an invalid character a ValueError.
    except (SyntaxError, ValueError) as error:
        # The text of a ParseError contains a file name that does not exist.
        why = next(iter(_faults(parser)), getattr(error, "msg", None) or error)
        raise DescriptionError(f"The {label} is not XML: {why}.") from error
    if root.getroottree().docinfo.doctype:
        raise DescriptionError(f"The {label} has a DOCTYPE, which is not allowed.")
    return root


def _parser(keep_comments: bool, recover: bool = False) -> etree.XMLParser:
    """Make a safe parser; with ``recover`` it accepts invalid XML."""
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
    """List the errors of a document, except on namespaces."""
    return [
        f"{entry.message}, line {entry.line}, column {entry.column}"
        for entry in parser.error_log
        if entry.domain != etree.ErrorDomains.NAMESPACE
    ]


def local_name(element: etree._Element) -> str:
    """Return the tag of an element without its prefix, declared or not."""
    return str(element.tag).rpartition("}")[2].rpartition(":")[2]


def part_at_fault(
    root: etree._Element, is_readable: Callable[[etree._Element], bool]
) -> str:
    """Find the child of an element that makes it unreadable.

    Args:
        root: An element that cannot be read.
        is_readable: Returns whether an element can be read; called with the root and
            one child at a time.

    Returns:
        Tag, name and line of the first such child, with a colon; empty if each child
        alone can be read.
    """
    for part in root:
        alone = etree.Element(root.tag, root.attrib)
        alone.append(copy.deepcopy(part))
        if not is_readable(alone):
            return f"<{part.tag}> {part.get('name', '')}, line {part.sourceline}: "
    return ""
