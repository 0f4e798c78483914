"""What a CAN port says of a name that cannot be opened."""

import pytest

from tactemu.base.errors import TransportUnavailable
from tactemu.transports import create


def test_a_name_that_no_interface_can_have_is_no_reason_to_make_one():
    with pytest.raises(TransportUnavailable, match="no interface whose name is longer than 15 bytes; shorten it"):
        create("can:socketcan:a_name_of_sixteen").open()
