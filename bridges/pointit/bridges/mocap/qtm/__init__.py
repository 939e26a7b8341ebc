"""QTM RT, the protocol of Qualisys Track Manager: session, connection, search."""
