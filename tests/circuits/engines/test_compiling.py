"""Compiled code kept between runs."""

from circuits.engines.ensemble import kernel, lanes


def test_compiled_code_is_kept_under_a_hash_of_all_sources():
    from circuits.engines import compiling

    for function in (kernel.trial, lanes.lif_identical):
        assert compiling.STATE in function.stats.cache_path
