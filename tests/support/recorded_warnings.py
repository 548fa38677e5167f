# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Recording of the warnings of one category."""

import re
import warnings
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def recorded_warnings(
    match: str | None = None, category: type[Warning] = UserWarning
) -> Iterator[list[warnings.WarningMessage]]:
    """Yield a list that warnings of a block are added to, and check that one of them matches a pattern.

    Other categories are ignored: a garbage collection in the block may warn of files that another test left open.
    """
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("ignore")
        warnings.simplefilter("always", category)
        yield caught
    messages = [str(item.message) for item in caught]
    assert match is None or any(re.search(match, message) for message in messages), (match, messages)
