"""XML from outside, read so that it can do no harm.

Nothing is fetched, no file is opened for an entity, and a document that declares
entities is refused: what it means could be a thousand times its length.
"""

from __future__ import annotations

from lxml import etree

from .errors import DescriptionError


def parse_xml(what: str, text: str) -> etree._Element:
    """Read a document.

    Args:
        what: What it should be, for the sentences: "robot description".
        text: XML; a declared encoding is passed over, the text is text already.

    Returns:
        The root element, without comments and processing instructions.

    Raises:
        DescriptionError: If it is not XML, or declares entities.
    """
    parser = etree.XMLParser(
        resolve_entities=False,
        no_network=True,
        load_dtd=False,
        huge_tree=False,
        remove_comments=True,
        remove_pis=True,
        encoding="utf-8",
    )
    try:
        root = etree.fromstring(text.encode("utf-8"), parser)
    # A reader's ParseError is a SyntaxError, a character that is none a ValueError.
    except (SyntaxError, ValueError) as error:
        raise DescriptionError(f"The {what} is not XML: {error}.") from error
    if root.getroottree().docinfo.doctype:
        raise DescriptionError(f"The {what} has a DOCTYPE; no entities are read.")
    return root
