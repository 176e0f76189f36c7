"""PictureWindow: shows pictures on the screen, where there is one."""

from __future__ import annotations

from contextlib import suppress
from typing import Any

import numpy as np
import numpy.typing as npt


class PictureWindow:
    """A window that is opened with the first picture; without a display, or once closed by the user, it stays away.

    Args:
        title: Text in its frame.
    """

    def __init__(self, title: str) -> None:
        self._title = title
        self._root: Any = None
        self._label: Any = None
        self._is_absent = False

    def show(self, picture: npt.NDArray[np.uint8]) -> None:
        """Show a picture, shape (height, width, 3)."""
        if self._is_absent:
            return
        try:
            # Some builds of Python have no Tk.
            import tkinter
        except ImportError:
            self._is_absent = True
            return
        height, width = picture.shape[:2]
        try:
            if self._root is None:
                self._root = tkinter.Tk()
                self._root.title(self._title)
                self._label = tkinter.Label(self._root)
                self._label.pack()
            data = f"P6 {width} {height} 255\n".encode() + picture.tobytes()
            image = tkinter.PhotoImage(master=self._root, data=data, format="PPM")
            self._label.configure(image=image)
            self._label.image = image  # Tk itself does not keep it
            self._root.update()
        except tkinter.TclError:
            self._root, self._is_absent = None, True

    def close(self) -> None:
        """Take the window away; calling twice is harmless."""
        if self._root is not None:
            import tkinter

            with suppress(tkinter.TclError):  # the user may have closed it
                self._root.destroy()
            self._root = None
