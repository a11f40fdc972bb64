"""What a page sends: bounded in length and in time, before anything reads it."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Mapping
from typing import Any

from starlette.requests import Request

from ...base.errors import ConfigurationError

LARGEST = 1 << 16
"""Bytes of a request, or of a message on a socket: the participant's page is the least trusted one."""
PATIENCE = 10.0
"""s for a client to send what it has begun to send."""


async def json_object(request: Request) -> Mapping[str, Any]:
    """The JSON object of a request; {} without a body. Raises ConfigurationError when there is none."""
    content = b""
    try:
        async with asyncio.timeout(PATIENCE):
            async for piece in request.stream():
                content += piece
                if len(content) > LARGEST:
                    raise ConfigurationError(f"The request is longer than {LARGEST} bytes.")
    except TimeoutError:
        raise ConfigurationError(f"The request was not sent within {PATIENCE:g} s.") from None
    try:
        values = json.loads(content or b"{}")
    except (ValueError, RecursionError):
        values = None
    if not isinstance(values, Mapping):
        raise ConfigurationError("The request is no JSON object.")
    return values
