//! Role: steps one world; tells each agent what that agent sees, and nothing else.
