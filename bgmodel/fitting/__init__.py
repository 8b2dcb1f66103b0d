"""Models held to choices and times: what a test or a circuit must be to decide as an animal did."""
