"""Nodes of the tests that speak TCPROS on sockets of their own."""
