"""The window of VTK under everything: its renderers, its interactor, and its picture."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from corpus_tools.inspection.paint import BLUE, RED, Colour
from corpus_tools.inspection.plates import Block, Plate
from mocap_fit.errors import MissingExtraError
from mocap_fit.render.scene import require_off_screen

Area = tuple[int, int, int, int]
"""Left, bottom, width and height, pixels from the lower left corner of the window."""

_STAGE_PAPER: Colour = (232, 236, 241)
# Milliseconds between looks at the clock.
_TICK = 15


class Screen:
    """A window on a screen, or none: what is drawn is the same.

    Parameters
    ----------
    size
        Width and height, pixels.
    off_screen
        Whether it is drawn without a screen.

    Raises
    ------
    MissingExtraError
        If there is no screen, or nothing that draws without one.
    """

    def __init__(self, size: tuple[int, int], *, off_screen: bool) -> None:
        if off_screen:
            require_off_screen()
        else:
            _require_screen()
        import pyvista
        from vtkmodules.vtkInteractionStyle import vtkInteractorStyleTrackballCamera
        from vtkmodules.vtkRenderingCore import vtkRenderer
        from vtkmodules.vtkRenderingUI import vtkGenericRenderWindowInteractor

        plotter: Any = pyvista.Plotter(
            off_screen=off_screen,
            window_size=list(size),
            lighting="none",
            notebook=False,
            title="mocap-fit inspect",
        )
        plotter.set_background([each / 255 for each in _STAGE_PAPER])
        plotter.render_window.SetMultiSamples(0)
        flat: Any = vtkRenderer()
        flat.SetLayer(1)
        flat.InteractiveOff()
        plotter.render_window.SetNumberOfLayers(2)
        plotter.render_window.AddRenderer(flat)
        self.plotter, self.size = plotter, size
        names = ("names", "title", "legend", "strip", "panel", "status")
        self._plates = {name: Plate(flat) for name in names}
        self._painted: dict[str, object] = {}
        self.selection = Block(flat, BLUE, 0.16)
        self.cursor = Block(flat, RED)
        if off_screen:
            self.interactor: Any = vtkGenericRenderWindowInteractor()
            self.interactor.SetRenderWindow(plotter.render_window)
        else:
            self.interactor = plotter.iren.interactor
        self.style: Any = vtkInteractorStyleTrackballCamera()
        self.style.SetDefaultRenderer(plotter.renderer)
        self.interactor.SetInteractorStyle(self.style)
        plotter.show(
            auto_close=False,
            interactive=False,
            interactive_update=not off_screen,
        )

    def put(
        self,
        name: str,
        area: Area,
        key: object,
        paint: Callable[[int, int], NDArray[np.uint8]],
    ) -> None:
        """Show a flat picture, which is painted unless it shows the same already.

        Parameters
        ----------
        name
            Its name.
        area
            Where it is.
        key
            What it shows: equal keys look the same; None is always painted.
        paint
            Takes width and height, pixels, and returns the picture.
        """
        left, bottom, width, height = area
        if key is None or self._painted.get(name) != (area, key):
            self._painted[name] = (area, key)
            self._plates[name].update(paint(width, height), left, bottom)

    def hide(self, name: str) -> None:
        """Hide a flat picture.

        Parameters
        ----------
        name
            Its name.
        """
        self._painted.pop(name, None)
        self._plates[name].hide()

    def clear(self) -> None:
        """Forget what is in space, and what is painted."""
        self.plotter.renderer.RemoveAllViewProps()
        self._painted.clear()

    def set_stage(self, area: Area) -> None:
        """Set where that what is in space is seen.

        Parameters
        ----------
        area
            The area.
        """
        (left, bottom, width, height), (full, tall) = area, self.size
        self.plotter.renderer.SetViewport(
            left / full, bottom / tall, (left + width) / full, (bottom + height) / tall
        )

    def render(self) -> None:
        """Draw everything."""
        self.plotter.render_window.Render()

    def capture(self) -> NDArray[np.uint8]:
        """Return the picture of the window.

        Returns
        -------
        ndarray
            Red, green and blue, ``(height, width, 3)``.
        """
        from vtkmodules.util import numpy_support
        from vtkmodules.vtkCommonCore import vtkUnsignedCharArray

        to_numpy: Any = numpy_support.vtk_to_numpy
        width, height = self.size
        pixels = vtkUnsignedCharArray()
        window = self.plotter.render_window
        window.GetRGBACharPixelData(0, 0, width - 1, height - 1, 0, pixels)
        picture = np.asarray(to_numpy(pixels)).reshape(height, width, 4)[::-1, :, :3]
        return np.ascontiguousarray(picture)

    def measure(self) -> bool:
        """Measure the window, and tell whether its size has changed.

        Returns
        -------
        bool
            Whether it has.
        """
        width, height = self.plotter.render_window.GetSize()
        if (width, height) == self.size or min(width, height) < 200:
            return False
        self.size = (width, height)
        return True

    def start(self) -> None:
        """Show the window until it is closed."""
        self.interactor.CreateRepeatingTimer(_TICK)
        self.interactor.Start()

    def close(self) -> None:
        """Free its memory."""
        self.plotter.close()


def _require_screen() -> None:
    """Refuse a window where there is no screen."""
    display = os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    if sys.platform == "linux" and not display:
        raise MissingExtraError(
            "there is no screen for a window here",
            found="no DISPLAY",
            advice="Use --html FILE for a page that a browser shows, --screenshot FILE or "
            "--movie FILE; over SSH, ssh -X brings the screen along.",
        )
