# SPDX-License-Identifier: MIT
"""What keeps the add-on from an answer."""


class Problem(Exception):
    """One line that says what is wrong and what to do, for the user."""
