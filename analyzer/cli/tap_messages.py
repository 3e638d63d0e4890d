"""Where the messages of a tap go: standard error, or the live screen while it is shown."""

from __future__ import annotations

from contextlib import ExitStack

from analyzer.cli.live_screen import LiveScreen
from analyzer.cli.messages import Messages

__all__ = ["TapMessages"]


class TapMessages:
    """Routes messages of the tap: to standard error, or to the live screen while it is shown."""

    def __init__(self, messages: Messages) -> None:
        self.screen: LiveScreen | None = None
        self._messages = messages
        self._screen_is_shown = False

    @property
    def quit_requested(self) -> bool:
        """Whether the user has asked the live screen to end."""
        return self.screen is not None and self.screen.quit_requested

    def info(self, text: str) -> None:
        """Show one message."""
        if self.screen is not None and self._screen_is_shown:
            self.screen.show_message(text)
        else:
            self._messages.info(text)

    def use_screen(self) -> ExitStack:
        """Show the screen inside the `with` block; its messages are printed afterwards."""
        stack = ExitStack()
        if self.screen is not None:
            self._screen_is_shown = True
            stack.callback(self._leave_screen, self.screen)
            stack.enter_context(self.screen)
        return stack

    def _leave_screen(self, screen: LiveScreen) -> None:
        self._screen_is_shown = False
        for text in screen.messages:
            self._messages.info(text)
