"""Writes a tetrahedron as 3MF, which servers load in a sandboxed process. usage: make_3mf.py OUT.3mf"""

import sys
import zipfile

PACKAGE = "http://schemas.openxmlformats.org/package/2006"
MANUFACTURING = "http://schemas.microsoft.com/3dmanufacturing"
CORNERS = [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)]
SIDES = [(0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)]


def write_3mf(path):
    corners = "".join(f'<vertex x="{x}" y="{y}" z="{z}"/>' for x, y, z in CORNERS)
    sides = "".join(f'<triangle v1="{a}" v2="{b}" v3="{c}"/>' for a, b, c in SIDES)
    mesh = f"<mesh><vertices>{corners}</vertices><triangles>{sides}</triangles></mesh>"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as file:
        kind = "application/vnd.ms-package.3dmanufacturing-3dmodel+xml"
        types = f'<Types xmlns="{PACKAGE}/content-types"><Default Extension="model" ContentType="{kind}"/></Types>'
        file.writestr("[Content_Types].xml", types)
        link = f'<Relationship Id="r" Target="/3D/3dmodel.model" Type="{MANUFACTURING}/2013/01/3dmodel"/>'
        file.writestr("_rels/.rels", f'<Relationships xmlns="{PACKAGE}/relationships">{link}</Relationships>')
        parts = f'<resources><object id="1" type="model">{mesh}</object></resources><build><item objectid="1"/></build>'
        file.writestr("3D/3dmodel.model", f'<model unit="meter" xmlns="{MANUFACTURING}/core/2015/02">{parts}</model>')


if __name__ == "__main__":
    write_3mf(sys.argv[1])
