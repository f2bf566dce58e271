"""Writes files as VTK, ParaView's library, writes them: a sphere as mesh files, and particles as VTU and VTP in
every kind of encoding. Argument: the folder."""

import itertools
import sys
from pathlib import Path

try:
    import vtk
except ImportError:
    sys.exit(77)

folder = Path(sys.argv[1])

ball = vtk.vtkSphereSource()
ball.SetRadius(0.25)
ball.SetThetaResolution(24)
ball.SetPhiResolution(13)
# Poles and seam are repeated where normals are; welding is the reader's work.
for name, writer in [("stl", vtk.vtkSTLWriter), ("ply", vtk.vtkPLYWriter)]:
    for kind in ["ASCII", "Binary"]:
        w = writer()
        w.SetInputConnection(ball.GetOutputPort())
        getattr(w, f"SetFileTypeTo{kind}")()
        w.SetFileName(str(folder / f"{kind.lower()}.{name}"))
        assert w.Write() == 1
w = vtk.vtkPLYWriter()
w.SetInputConnection(ball.GetOutputPort())
w.SetFileTypeToBinary()
w.SetDataByteOrderToBigEndian()
w.SetFileName(str(folder / "big.ply"))
assert w.Write() == 1
w = vtk.vtkOBJWriter()
w.SetInputConnection(ball.GetOutputPort())
w.SetFileName(str(folder / "faces.obj"))
assert w.Write() == 1

COUNT = 1000
points = vtk.vtkPoints()
points.SetDataTypeToDouble()
radius, spin, velocity = vtk.vtkFloatArray(), vtk.vtkDoubleArray(), vtk.vtkFloatArray()
material = vtk.vtkIntArray()
for array, name, components in [
    (radius, "Radius", 1),
    (velocity, "velocity", 3),
    (spin, "Angular_Velocity", 3),
    (material, "material", 1),
]:
    array.SetName(name)
    array.SetNumberOfComponents(components)
for k in range(COUNT):
    points.InsertNextPoint(k / 8, -k / 16, k / 1024)
    radius.InsertNextValue(0.0078125 + k / 65536)
    velocity.InsertNextTuple3(k, 0.5, -1)
    spin.InsertNextTuple3(0, -k, 0.25)
    material.InsertNextValue(k % 2)


def filled(data):
    data.SetPoints(points)
    for array in [radius, velocity, spin, material]:
        data.GetPointData().AddArray(array)
    return data


for data, writer, extension in [
    (filled(vtk.vtkUnstructuredGrid()), vtk.vtkXMLUnstructuredGridWriter, "vtu"),
    (filled(vtk.vtkPolyData()), vtk.vtkXMLPolyDataWriter, "vtp"),
]:
    for mode, zipped, header, order in itertools.product(
        ["Ascii", "Binary", "Appended", "AppendedBase64"], [False, True], [32, 64], ["Little", "Big"]
    ):
        w = writer()
        w.SetInputData(data)
        w.SetCompressorTypeToZLib() if zipped else w.SetCompressorTypeToNone()
        # Small blocks, so that there are several and a shorter last one.
        w.SetBlockSize(3072)
        w.SetHeaderTypeToUInt64() if header == 64 else w.SetHeaderTypeToUInt32()
        getattr(w, f"SetByteOrderTo{order}Endian")()
        getattr(w, f"SetDataModeTo{mode.removesuffix('Base64')}")()
        w.SetEncodeAppendedData(mode == "AppendedBase64")
        w.SetFileName(str(folder / f"{mode}-{zipped}-{header}-{order}.{extension}"))
        assert w.Write() == 1
for kind in ["LZ4", "LZMA"]:
    w = vtk.vtkXMLPolyDataWriter()
    w.SetInputData(filled(vtk.vtkPolyData()))
    getattr(w, f"SetCompressorTypeTo{kind}")()
    w.SetFileName(str(folder / f"{kind}.vtp"))
    assert w.Write() == 1
print("written")
