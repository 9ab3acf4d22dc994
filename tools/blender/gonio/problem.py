# SPDX-License-Identifier: MIT
"""Error of the add-on."""


class Problem(Exception):
    """Error message for the user: one line with the problem and the remedy."""
