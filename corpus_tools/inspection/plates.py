"""Pictures and rectangles that lie flat on a window, over what is seen in space."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from corpus_tools.inspection.paint import Colour


class Plate:
    """A picture on the window.

    Parameters
    ----------
    renderer
        The renderer of flat things.
    """

    def __init__(self, renderer: Any) -> None:
        from vtkmodules.vtkCommonDataModel import vtkImageData
        from vtkmodules.vtkRenderingCore import (
            vtkPolyDataMapper2D,
            vtkTexture,
            vtkTexturedActor2D,
        )

        self._image = vtkImageData()
        texture = vtkTexture()
        texture.SetInputData(self._image)
        texture.InterpolateOff()
        texture.SetColorModeToDirectScalars()
        self._mapper = vtkPolyDataMapper2D()
        self.actor = vtkTexturedActor2D()
        self.actor.SetMapper(self._mapper)
        self.actor.SetTexture(texture)
        self.actor.VisibilityOff()
        self._size = (0, 0)
        renderer.AddViewProp(self.actor)

    def hide(self) -> None:
        """Show nothing."""
        self.actor.VisibilityOff()

    def update(self, pixels: NDArray[np.uint8], left: int, bottom: int) -> None:
        """Show another picture.

        Parameters
        ----------
        pixels
            Red, green, blue, and alpha where there is one, ``(height, width, 3 or 4)``.
        left, bottom
            Where its lower left corner is, pixels from that of the window.
        """
        from vtkmodules.util import numpy_support

        to_vtk: Any = numpy_support.numpy_to_vtk
        height, width, channels = pixels.shape
        self._image.SetDimensions(width, height, 1)
        flat = np.ascontiguousarray(pixels[::-1]).reshape(-1, channels)
        self._image.GetPointData().SetScalars(to_vtk(flat, deep=True))
        self._image.Modified()
        if (width, height) != self._size:
            self._size = (width, height)
            self._mapper.SetInputData(_build_quad(width, height, textured=True))
        self.actor.SetPosition(left, bottom)
        self.actor.VisibilityOn()


class Block:
    """A rectangle of one colour on the window, which is only moved and resized.

    Parameters
    ----------
    renderer
        The renderer of flat things.
    colour
        Red, green and blue.
    alpha
        Share that is covered, 0 to 1.
    """

    def __init__(self, renderer: Any, colour: Colour, alpha: float = 1.0) -> None:
        from vtkmodules.vtkRenderingCore import vtkActor2D, vtkPolyDataMapper2D

        self._mapper = vtkPolyDataMapper2D()
        self.actor = vtkActor2D()
        self.actor.SetMapper(self._mapper)
        self.actor.GetProperty().SetColor(*(each / 255 for each in colour))
        self.actor.GetProperty().SetOpacity(alpha)
        self.actor.VisibilityOff()
        self._size = (0, 0)
        renderer.AddViewProp(self.actor)

    def hide(self) -> None:
        """Show nothing."""
        self.actor.VisibilityOff()

    def update(self, left: float, bottom: float, width: float, height: float) -> None:
        """Show the rectangle.

        Parameters
        ----------
        left, bottom
            Its lower left corner, pixels from that of the window.
        width, height
            Its size, pixels.
        """
        size = (max(round(width), 1), max(round(height), 1))
        if size != self._size:
            self._size = size
            self._mapper.SetInputData(_build_quad(*size, textured=False))
        self.actor.SetPosition(round(left), round(bottom))
        self.actor.VisibilityOn()


def _build_quad(width: int, height: int, *, textured: bool) -> Any:
    from vtkmodules.util import numpy_support
    from vtkmodules.vtkCommonCore import vtkPoints
    from vtkmodules.vtkCommonDataModel import vtkCellArray, vtkPolyData

    corners = np.array([(0, 0), (1, 0), (1, 1), (0, 1)], dtype=np.float32)
    points, cells, quad = vtkPoints(), vtkCellArray(), vtkPolyData()
    for x, y in corners:
        points.InsertNextPoint(float(x) * width, float(y) * height, 0.0)
    cells.InsertNextCell(4, (0, 1, 2, 3))
    quad.SetPoints(points)
    quad.SetPolys(cells)
    if textured:
        to_vtk: Any = numpy_support.numpy_to_vtk
        quad.GetPointData().SetTCoords(to_vtk(corners, deep=True))
    return quad
