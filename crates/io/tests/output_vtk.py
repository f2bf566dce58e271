"""Reads .vtp and .vti files with VTK's own reader and prints what it found as JSON.

Usage: output_vtk.py COLLECTION.pvd. Numbers are printed as text, so that no JSON reader rounds them.
"""

import json
import os
import sys
import xml.etree.ElementTree

try:
    import vtk
except ImportError:
    sys.exit(77)


def values(array):
    """The values of a VTK array, one string each."""
    return [repr(array.GetValue(k)) for k in range(array.GetNumberOfValues())]


def columns(data):
    """All arrays of point, cell or field data."""
    arrays = (data.GetAbstractArray(k) for k in range(data.GetNumberOfArrays()))
    return {
        a.GetName(): {
            "type": a.GetDataTypeAsString(),
            "components": a.GetNumberOfComponents(),
            "values": values(a),
        }
        for a in arrays
    }


def cells(array):
    """The point indices of each cell."""
    ids = vtk.vtkIdList()
    found = []
    for k in range(array.GetNumberOfCells()):
        array.GetCellAtId(k, ids)
        found.append([ids.GetId(j) for j in range(ids.GetNumberOfIds())])
    return found


def read(path):
    """One .vtp or .vti file."""
    errors = []
    image = path.endswith(".vti")
    reader = vtk.vtkXMLImageDataReader() if image else vtk.vtkXMLPolyDataReader()
    reader.AddObserver("ErrorEvent", lambda *_: errors.append("reader reported an error"))
    reader.SetFileName(path)
    reader.Update()
    mesh = reader.GetOutput()
    if image:
        return {
            "errors": errors,
            "bounds": [repr(x) for x in mesh.GetBounds()],
            "dimensions": list(mesh.GetDimensions()),
            "cell_data": columns(mesh.GetCellData()),
            "field_data": columns(mesh.GetFieldData()),
        }
    return {
        "errors": errors,
        "points": values(mesh.GetPoints().GetData()) if mesh.GetPoints() else [],
        "verts": cells(mesh.GetVerts()),
        "lines": cells(mesh.GetLines()),
        "polys": cells(mesh.GetPolys()),
        "point_data": columns(mesh.GetPointData()),
        "cell_data": columns(mesh.GetCellData()),
        "field_data": columns(mesh.GetFieldData()),
    }


collection = sys.argv[1]
folder = os.path.dirname(collection)
sets = xml.etree.ElementTree.parse(collection).getroot().findall("Collection/DataSet")
json.dump([{**s.attrib, **read(os.path.join(folder, s.attrib["file"]))} for s in sets], sys.stdout)
