"""DJI's XMP, as photos carry it."""

from __future__ import annotations

DJI = 'xmlns:drone-dji="http://www.dji.com/drone-dji/1.0/"'


def packet(attributes: str = "", elements: str = "", before: str = "") -> bytes:
    text = (
        '<?xpacket begin="\ufeff" id="W5M0MpCehiHzreSzNTczkc9d"?>'
        f'{before}<x:xmpmeta xmlns:x="adobe:ns:meta/">'
        '<rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#">'
        f'<rdf:Description rdf:about="" {DJI} {attributes}>{elements}</rdf:Description>'
        '</rdf:RDF></x:xmpmeta>\n   <?xpacket end="w"?>\0'
    )
    return text.encode()
