// The little of node that tests use; its own types are no dependency of ours.

declare module "node:test" {
  export function test(name: string, run: () => void | Promise<void>): Promise<void>;
  export const mock: {
    method(of: object, name: string, as: (...given: never[]) => unknown): void;
    restoreAll(): void;
    timers: { enable(which: { apis: string[] }): void; tick(ms: number): void };
  };
}

declare module "node:assert/strict" {
  interface Assert {
    (value: unknown, message?: string): asserts value;
    ok(value: unknown, message?: string): asserts value;
    equal(found: unknown, expected: unknown, message?: string): void;
    notEqual(found: unknown, expected: unknown, message?: string): void;
    deepEqual(found: unknown, expected: unknown, message?: string): void;
    match(found: string, expected: RegExp, message?: string): void;
    doesNotMatch(found: string, expected: RegExp, message?: string): void;
    throws(run: () => unknown, expected?: RegExp): void;
    rejects(run: Promise<unknown> | (() => Promise<unknown>), expected?: RegExp): Promise<void>;
  }
  const assert: Assert;
  export default assert;
}
